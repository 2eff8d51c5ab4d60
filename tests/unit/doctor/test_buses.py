import pytest

from hil_bench.abilities.doctor.machine import Verdict
from hil_bench.abilities.doctor.verbs import examine_buses
from hil_bench.outside.transports.socketcan import CanInterface


@pytest.fixture
def examine(monkeypatch):
    def examine_with(*interfaces, has_socketcan=True, rmem_max="212992", modules=""):
        place = "hil_bench.abilities.doctor.verbs."
        monkeypatch.setattr(place + "has_socketcan", lambda: has_socketcan)
        monkeypatch.setattr(place + "can_interfaces", lambda: list(interfaces))

        def read(path):
            if path.endswith("modules.dep"):
                return modules
            return rmem_max if path.endswith("rmem_max") else ""

        return {item.name: item for item in examine_buses(read).findings}

    return examine_with


def test_without_socketcan_there_is_the_hub(examine):
    found = examine(has_socketcan=False)
    assert found["SocketCAN"].verdict is Verdict.MISSING
    assert "'hil-bench run --hub'" in found["SocketCAN"].advice


def test_an_interface_that_is_down_says_how_to_start_it(examine):
    found = examine(
        CanInterface("can0", is_up=False, kind="can"),
        CanInterface("can1", is_up=True, kind="can", bitrate=500_000),
        CanInterface("vcan0", is_up=False, kind="vcan"),
    )
    assert found["can0"].advice == "'ip link set can0 up type can bitrate 500000'"
    assert (found["can1"].verdict, found["can1"].value) == (Verdict.GOOD, "can, up, 500 kbit/s")
    assert found["vcan0"].advice == "'ip link set vcan0 up'"
    assert found["vcan"].value == "in use"


def test_without_an_interface_there_is_a_way_to_one(examine):
    assert "ip link add dev vcan0 type vcan" in examine()["interfaces"].advice


@pytest.mark.parametrize(
    ("modules", "verdict"),
    [
        ("kernel/drivers/net/can/vcan.ko.xz: kernel/drivers/net/can/dev/can-dev.ko.xz", "good"),
        ("kernel/drivers/net/can/slcan.ko.xz:", "hint"),
    ],
)
def test_a_module_that_can_be_loaded_is_there(examine, monkeypatch, modules, verdict):
    monkeypatch.setattr("hil_bench.abilities.doctor.verbs.Path.exists", lambda _path: False)
    assert examine(modules=modules)["vcan"].verdict == verdict


def test_a_small_receive_buffer_is_a_hint(examine):
    assert examine()["receive buffer"].verdict is Verdict.HINT
    # 8 MiB are what the transport asks for.
    assert examine(rmem_max="8388608")["receive buffer"].verdict is Verdict.GOOD


def test_elsewhere_there_is_the_hub_too(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.doctor.verbs.IS_LINUX", False)
    (item,) = examine_buses(lambda _path: "").findings
    assert (item.verdict, item.value) == (Verdict.ABSENT, "Linux only")
