"""What this machine can do for a bench in real time, and what to change where it could do more.

Each module looks at one topic and gives findings; none of them changes anything.
"""
