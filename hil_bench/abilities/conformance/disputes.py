"""Clauses that careful readers understand in more than one way, and how the checks read them."""

from typing import Final

_TEXT: Final = """\
7.2.4.3.1: no clause says what a server does with a request that is a byte short: silence, an abort,
and the answer, where index and sub-index are there, all pass.

7.2.4.3.3: a server may take an expedited download without a size, or abort it: both pass.

7.2.4.3.10, 7.2.4.3.14: no clause names the abort code for a segment number that does not fit, in
an upload or in a download: 0504 0003h (invalid sequence number) and 0504 0001h (command specifier
not valid) both pass.

7.2.4.3.11: no clause names the abort code for a block download that ends with fewer bytes than
announced: 0607 001xh and 0504 0001h pass.

7.2.4.3.14: no clause says what a server does where the client confirms more segments than were
sent: it may take that as all that were sent, and go on.

7.2.4.3.17: a server may leave a segment out whose toggle bit is wrong, as one that it has already;
it must not take it.

7.2.4.3.17: no clause says how long a server waits for its client: a server that waits longer than
the check does is not judged; one that gives up says 0504 0000h.

7.2.7.1: no clause says when a communication error is over: a device may keep it until a reset. Then
1001h shows it as long, and there is no EMCY 0000h.

7.2.8.3.2.1: no clause says whether node guarding is answered while 100Ch and 100Dh are 0: where it
is not, it is asked for with both set.

7.3.2.2.3: a device may leave OPERATIONAL by an error of its own (1029h). One check fails all the
same and names the cause, for nothing that needs OPERATIONAL can be seen then; the checks of that
are not run, and not passed.

7.5.2.4: beyond the number of errors, 0609 0011h of older editions passes as well as 0800 0024h.

7.5.2.35: a device may use the event timer of an RPDO to watch it: EMCY 8250h is recommended.

CiA 305, identify remote slave: a slave that is selected by its address and says nothing to this
does not have the service: not applicable. So it is with configure bit timing.
"""

DISPUTES: Final = tuple(" ".join(entry.split()) for entry in _TEXT.split("\n\n"))
"""A clause and its reading each, in the order of the clauses; other documents come last."""
