"""What the kernel and iproute2 say of the CAN interfaces, as they say it."""

import json
import subprocess

from hil_bench.outside.transports.socketcan import CanInterface, bitrate_of, can_interfaces, is_up

SIOCGIFFLAGS, SIOCGIFHWADDR = 0x8913, 0x8927  # linux/sockios.h

# From `ip -json -details link show dev can0` (iproute2 6.1) on hardware.
HARDWARE = [
    {
        "ifname": "can0",
        "linkinfo": {
            "info_kind": "can",
            "info_data": {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 500000}},
        },
    }
]


def make_interfaces(monkeypatch, **interfaces):
    """Have the kernel tell of these: its type and its flags a name."""
    place = "hil_bench.outside.transports.socketcan."
    monkeypatch.setattr(place + "socket.if_nameindex", lambda: list(enumerate(interfaces, 1)))
    answers = {
        (name, request): number
        for name, numbers in interfaces.items()
        for request, number in zip((SIOCGIFHWADDR, SIOCGIFFLAGS), numbers, strict=True)
    }
    monkeypatch.setattr(place + "_ask", lambda name, request: answers.get((name, request), 0))


def answer_with(monkeypatch, stdout, returncode=0):
    def run(command, *, check, **_options):
        result = subprocess.CompletedProcess(command, returncode, stdout, b"")
        if check:
            result.check_returncode()
        return result

    monkeypatch.setattr("hil_bench.outside.transports.socketcan.shutil.which", lambda name: name)
    monkeypatch.setattr("hil_bench.outside.transports.socketcan.subprocess.run", run)


def test_the_can_interfaces_are_those_of_the_kernels_type(monkeypatch):
    monkeypatch.setattr("hil_bench.outside.transports.socketcan.shutil.which", lambda _name: None)
    # 280 is ARPHRD_CAN, 1 Ethernet (linux/if_arp.h); bit 0 of the flags is IFF_UP (linux/if.h).
    make_interfaces(monkeypatch, vcan1=(280, 0x0080), eth0=(1, 0x1003), vcan0=(280, 0x00C1))
    assert can_interfaces() == [
        CanInterface("vcan0", is_up=True),
        CanInterface("vcan1", is_up=False),
    ]
    assert (is_up("vcan0"), is_up("vcan1"), is_up("vcan2")) == (True, False, False)


def test_the_kernel_is_asked():
    assert is_up("lo")  # each Linux has it, and it is up
    assert not is_up("no-such-name")


def test_iproute2_knows_the_kind_and_the_bit_rate(monkeypatch):
    answer_with(monkeypatch, json.dumps(HARDWARE).encode())
    make_interfaces(monkeypatch, can0=(280, 0x00C1))
    assert can_interfaces() == [CanInterface("can0", is_up=True, kind="can", bitrate=500_000)]
    assert bitrate_of("can0") == 500_000


def test_an_answer_that_nobody_understands_says_nothing(monkeypatch):
    for stdout in (b"", b"[]", b"[{}]", b"no JSON", b"[1]"):
        answer_with(monkeypatch, stdout)
        assert bitrate_of("can0") is None
    answer_with(monkeypatch, b"", returncode=1)
    assert bitrate_of("can0") is None
