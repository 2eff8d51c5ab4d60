import errno
import os
import socket

import can
import pytest

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.outside.transports.opening import PythonCanTransport, open_transport
from hil_bench.outside.transports.socketcan import SocketCanTransport


@pytest.fixture(autouse=True)
def configuration(monkeypatch, tmp_path):
    """The path of python-can's only configuration file, which does not exist yet."""
    for name in [name for name in os.environ if name.startswith("CAN_")]:
        monkeypatch.delenv(name)
    path = tmp_path / "can.conf"
    monkeypatch.setattr(can.util, "CONFIG_FILES", [str(path)])
    return path


def refusal(interface=None, channel=None, **options):
    """Return what is said when this bus is opened."""
    with pytest.raises(BusError) as caught:
        open_transport(interface, channel, None, options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def socketcan_refusal(monkeypatch, code, channel="vcan9"):
    def refuse(*_args, **_kwargs):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(can, "Bus", refuse)
    return refusal("socketcan", channel)


def test_any_interface_of_python_can_opens():
    transport = open_transport("virtual", "test_opening", 500_000, {"receive_own_messages": True})
    assert isinstance(transport, PythonCanTransport)
    assert transport.description == "virtual test_opening"
    transport.send([Frame(0x181, b"\x01")])
    assert transport.receive(10) == [Frame(0x181, b"\x01")]  # so the option arrived
    transport.close()


def test_what_is_not_given_comes_from_the_environment(monkeypatch):
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "from_environment")
    transport = open_transport(None, None, None, {})
    assert transport.description == "virtual from_environment"
    transport.close()


def test_what_is_not_given_comes_from_the_file(configuration):
    configuration.write_text("[default]\ninterface = virtual\nchannel = from_file\n")
    transport = open_transport(None, "given", None, {})
    assert transport.description == "virtual given"
    transport.close()


def test_no_interface_anywhere_names_the_ways_to_choose_one():
    assert refusal().startswith("no CAN interface chosen; '-i socketcan -c vcan0'")
    assert "'hil-bench run --hub' makes a bus that needs none" in refusal()


def test_an_unknown_interface_names_the_nearest():
    text = refusal("socketkan", "vcan0")
    assert text == "unknown CAN interface 'socketkan'; python-can has socketcan, socketcand"


def test_an_interface_like_no_other_names_them_all():
    assert "kvaser" in refusal("zzz", "vcan0")


def test_a_malformed_setting_is_refused():
    assert refusal("socketcand", "can0", host="h", port="x") == (
        "a setting of the bus, or python-can's configuration: Port config must be a number!"
    )


def test_a_malformed_environment_is_refused(monkeypatch):
    monkeypatch.setenv("CAN_CONFIG", "{")
    assert refusal("virtual", "x").startswith(
        "a setting of the bus, or python-can's configuration: Expecting property name"
    )


def test_a_missing_argument_is_named():
    assert refusal("serial").startswith("serial None: ")


def test_options_that_do_not_fit_are_named(monkeypatch):
    class StrictBus:
        def __init__(self, channel, interface, *, ignore_config):
            raise AssertionError(channel, interface, ignore_config)

    monkeypatch.setattr(can, "Bus", StrictBus)
    text = refusal("virtual", "x", colour="red")
    assert text == "virtual x: options do not fit: got an unexpected keyword argument 'colour'"


@pytest.mark.parametrize(
    "error",
    [
        can.CanInterfaceNotImplementedError("Cannot import module x: No module named 'usb'"),
        ImportError("No module named 'usb'"),
        NameError("name 'canGetNumberOfChannels' is not defined"),  # kvaser without its library
    ],
)
def test_a_missing_driver_or_package_is_said(monkeypatch, error):
    def refuse(**_kwargs):
        raise error

    monkeypatch.setattr(can, "Bus", refuse)
    assert refusal("gs_usb", 0) == (
        f"gs_usb 0: its driver or Python package is missing ({error}); see 'CAN Interface Modules' "
        "in the documentation of python-can"
    )


@pytest.mark.parametrize(
    ("error", "said"),
    [(RuntimeError("first line\nsecond line"), "first line"), (RuntimeError(), "RuntimeError")],
)
def test_any_other_failure_is_one_line(monkeypatch, error, said):
    def refuse(**_kwargs):
        raise error

    monkeypatch.setattr(can, "Bus", refuse)
    assert refusal("pcan", "PCAN_USBBUS1") == f"pcan PCAN_USBBUS1: {said}"


@pytest.mark.parametrize("channel", [None, ""])
def test_socketcan_without_a_channel_is_refused(channel):
    assert refusal("socketcan", channel) == "socketcan: no channel; '-c vcan0' names one"


@pytest.mark.parametrize("code", [errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT])
def test_a_kernel_without_can_sockets_points_to_the_hub(monkeypatch, code):
    text = socketcan_refusal(monkeypatch, code)
    assert text.startswith("socketcan vcan9: this kernel has no CAN sockets; 'modprobe can_raw'")
    assert "'hil-bench run --hub'" in text


def test_a_missing_virtual_interface_comes_with_the_command_that_makes_it(monkeypatch):
    assert socketcan_refusal(monkeypatch, errno.ENODEV) == (
        "socketcan vcan9: no such device; 'ip link add dev vcan9 type vcan' makes one"
    )


def test_a_missing_physical_interface_comes_with_the_command_that_lists_them(monkeypatch):
    assert socketcan_refusal(monkeypatch, errno.ENODEV, "can3") == (
        "socketcan can3: no such CAN device; 'ip -brief link show type can' lists those there are"
    )


def test_another_error_of_socketcan_keeps_its_words(monkeypatch):
    assert "Operation not permitted" in socketcan_refusal(monkeypatch, errno.EPERM)


class FakeSocketcanBus:
    def __init__(self, so_error):
        self.socket, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.so_error = so_error
        self.is_shut_down = False

    def shutdown(self):
        self.is_shut_down = True
        self.socket.close()
        self.far.close()


def test_socketcan_takes_the_fast_path(monkeypatch):
    bus = FakeSocketcanBus(0)
    monkeypatch.setattr(can, "Bus", lambda **_kwargs: bus)
    transport = open_transport("socketcan", "vcan0", None, {})
    assert isinstance(transport, SocketCanTransport)
    assert transport.description == "socketcan vcan0"
    transport.close()
    assert bus.is_shut_down


def test_an_interface_that_is_down_is_closed_again(monkeypatch):
    class DownSocket:
        def setblocking(self, flag):
            pass

        def setsockopt(self, level, option, value):
            pass

        def getsockopt(self, _level, option):
            return errno.ENETDOWN if option == socket.SO_ERROR else 0

        def close(self):
            pass

    bus = FakeSocketcanBus(0)
    bus.socket.close()
    bus.socket = DownSocket()
    monkeypatch.setattr(can, "Bus", lambda **_kwargs: bus)
    assert refusal("socketcan", "vcan0").startswith("socketcan vcan0: the interface is down; 'ip ")
    assert bus.is_shut_down


def test_socketcand_without_an_address_is_refused():
    assert refusal("socketcand", "can0") == (
        "socketcand can0: address incomplete; "
        "'-c can0 --bus-kwargs host=127.0.0.1 port=29536' is one"
    )


def test_socketcand_that_does_not_answer_is_said_at_once():
    with socket.socket() as taken:  # bound but not listening: connecting is refused
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        text = refusal("socketcand", "can0", host="127.0.0.1", port=port)
    assert text.startswith(f"socketcand can0: nobody answers at 127.0.0.1:{port} (")
    assert "hil-bench run --hub" in text
