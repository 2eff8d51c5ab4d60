"""A third party's device and plant for hil-bench."""
