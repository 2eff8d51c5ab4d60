"""The start of programs of tests that are controllers on a bus of the bench's hub."""

JOIN = """
import os, signal, socket, sys
host, port = os.environ["HIL_BENCH_BUS"].split(":")
bus = socket.create_connection((host, int(port)))
def hear(end=b">"):
    text = b""
    while not text.endswith(end):
        text += bus.recv(1)
    return text.decode()
def say(text):
    bus.sendall(text.encode())
hear(); say("< open can0 >"); hear(); say("< rawmode >"); hear()
def sync(count=1):
    for _ in range(count):
        say("< send 080 0 >")
    say("< send 604 8 40 00 10 00 00 00 00 00 >")
    while "frame 584" not in hear():
        pass
"""
"""They speak the socketcand protocol over a bare socket: they `hear` and `say`, and `sync`, which
has the position's node answer: then the bench has made the ticks."""
