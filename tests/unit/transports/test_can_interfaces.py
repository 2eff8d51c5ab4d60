"""What the kernel and iproute2 say of the CAN interfaces, as they say it."""

import json
import subprocess

from hil_bench.transports.can_interfaces import CanInterface, bitrate_of, can_interfaces

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


def make_sysfs(tmp_path, **interfaces):
    for name, (kind, flags) in interfaces.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
        (tmp_path / name / "flags").write_text(f"{flags}\n")
    return tmp_path


def answer_with(monkeypatch, stdout, returncode=0):
    def run(command, *, check, **_options):
        result = subprocess.CompletedProcess(command, returncode, stdout, b"")
        if check:
            result.check_returncode()
        return result

    monkeypatch.setattr("hil_bench.transports.can_interfaces.shutil.which", lambda name: name)
    monkeypatch.setattr("hil_bench.transports.can_interfaces.subprocess.run", run)


def test_the_can_interfaces_are_those_of_the_kernels_type(tmp_path, monkeypatch):
    monkeypatch.setattr("hil_bench.transports.can_interfaces.shutil.which", lambda _name: None)
    # 280 is ARPHRD_CAN, 1 Ethernet (linux/if_arp.h); bit 0 of the flags is IFF_UP (linux/if.h).
    sysfs = make_sysfs(tmp_path, vcan1=(280, "0x40080"), eth0=(1, "0x1003"), vcan0=(280, "0x400c1"))
    assert can_interfaces(sysfs) == [
        CanInterface("vcan0", is_up=True),
        CanInterface("vcan1", is_up=False),
    ]


def test_iproute2_knows_the_kind_and_the_bit_rate(tmp_path, monkeypatch):
    answer_with(monkeypatch, json.dumps(HARDWARE).encode())
    sysfs = make_sysfs(tmp_path, can0=(280, "0x400c1"))
    assert can_interfaces(sysfs) == [CanInterface("can0", is_up=True, kind="can", bitrate=500_000)]
    assert bitrate_of("can0") == 500_000


def test_an_answer_that_nobody_understands_says_nothing(monkeypatch):
    for stdout in (b"", b"[]", b"[{}]", b"no JSON", b"[1]"):
        answer_with(monkeypatch, stdout)
        assert bitrate_of("can0") is None
    answer_with(monkeypatch, b"", returncode=1)
    assert bitrate_of("can0") is None
