"""The valve: its set-up and its changes of state as transcripts, and other makers' EDS."""

import logging

import pytest

from device_profiles import VALVE_408
from hil_drivers import (
    DeviceFaultError,
    DeviceMismatchError,
    DriverTimeoutError,
    ProportionalValve,
    RemoteProtocolError,
    StaleValueError,
    ValveState,
)

TPDO = [0x60410010, 0x63010110]


@pytest.fixture
def valve(network):
    return ProportionalValve(network, 1)


@pytest.fixture
def set_up(set_up_tpdo, upload, download):
    """What `setup` says to our valve, with a command time-out of 100 ms."""
    return [
        *set_up_tpdo(1, 408, TPDO),
        upload(1, "6311.01", "00.40"),
        upload(1, "1600.00", "02"),
        upload(1, "1600.01", "10.00.40.60"),
        upload(1, "1600.02", "10.01.00.63"),
        download(1, "6042.00", "01"),
        upload(1, "1400.01", "01.02.00.00"),
        upload(1, "1400.05", "00.00"),
        download(1, "1400.01", "01.02.00.80"),
        download(1, "1400.05", "64.00"),
        download(1, "1400.01", "01.02.00.00"),
        download(1, "1016.01", "00.00.00.00"),
    ]


@pytest.fixture
def ready(valve, expected_protocol, set_up):
    with expected_protocol(set_up):
        valve.setup()
    return valve


def status(upload, word):
    return upload(1, "6041.00", f"{word:02X}.00")


def test_a_heartbeat_watch_names_us_and_the_time(
    valve, network, expected_protocol, set_up, download
):
    network.start_heartbeat(126, 10.0)
    network.pump()  # the first heartbeat; the next one comes after this test
    # 0x1016.01: reserved, node-ID 0x7E, then 250 ms = 0x00FA (CiA 301, consumer heartbeat time).
    with expected_protocol([*set_up[:-1], download(1, "1016.01", "FA.00.7E.00")]):
        valve.setup(heartbeat_timeout=0.25)


def test_a_heartbeat_watch_needs_a_heartbeat(valve, bus):
    with pytest.raises(ValueError, match=r"start_heartbeat\(\) first"):
        valve.setup(heartbeat_timeout=0.25)
    assert bus.sent == []


def test_a_command_timeout_needs_an_event_timer(network, edit_eds, set_up, expected_protocol):
    valve = ProportionalValve(network, 1, edit_eds(VALVE_408, {}, removed=["1400sub5"]))
    with (
        expected_protocol(set_up[:-5]),
        pytest.raises(DeviceMismatchError, match=r"has no 0x1400\.05"),
    ):
        valve.setup()


def test_the_reference_must_be_positive(valve, set_up_tpdo, upload, expected_protocol):
    with (
        expected_protocol([*set_up_tpdo(1, 408, TPDO), upload(1, "6311.01", "00.00")]),
        pytest.raises(DeviceMismatchError, match=r"0x6311\.01 \(reference value\) is 0"),
    ):
        valve.setup()


def test_full_pressure_must_be_positive(valve, upload, expected_protocol):
    message = r"0x6391\.01 \(reference value\) is 0"
    asked = upload(1, "6391.01", "00.00")
    with expected_protocol([asked]), pytest.raises(DeviceMismatchError, match=message):
        valve.set_pressure(0.5)
    asked = [upload(1, "6381.01", "00.10"), asked]
    with expected_protocol(asked), pytest.raises(DeviceMismatchError, match=message):
        valve.read_pressure()


@pytest.mark.parametrize(("prefix", "shown"), [("7F", 127), ("04", 4), ("F3", -13)])
def test_a_prefix_of_no_machine_is_refused(valve, upload, expected_protocol, prefix, shown):
    asked = [upload(1, "6600.02", "01"), upload(1, "6600.03", prefix)]
    message = rf"0x6600\.03 \(prefix\) is {shown}; -12"
    with expected_protocol(asked), pytest.raises(DeviceMismatchError, match=message):
        valve.set_axis_position(0.1)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        # Bits R M H D of the status word in the profile's table (Moog ACV manual); what stands
        # above them, here "local" and "ramp running", tells nothing about the state.
        (0b0000, ValveState.NOT_READY),
        (0b1000, ValveState.INIT),
        (0b1001, ValveState.DISABLED),
        (0b1011, ValveState.HOLD),
        (0x21F, ValveState.ACTIVE),
        (0b0111, ValveState.FAULT_REACTION),
        (0b0011, ValveState.FAULT_HOLD),
        (0b0001, ValveState.FAULT_DISABLED),
    ],
)
def test_state_and_spool_position(ready, network, bus, word, state):
    bus.play(f"181#{word.to_bytes(2, 'little').hex()}00.E0")  # 0xE000 = -8192
    network.pump()
    assert ready.state is state
    assert ready.spool_position == -0.5  # of the reference 0x4000


def test_a_status_that_is_no_state_is_a_protocol_error(ready, network, bus):
    bus.play("181#0D.00.00.00")
    network.pump()
    with pytest.raises(RemoteProtocolError, match="0x000D is no state"):
        _ = ready.state


def test_no_state_before_the_first_and_none_that_is_old(ready, network, bus):
    with pytest.raises(StaleValueError):
        _ = ready.state
    bus.play("181#0F.00.00.00")
    network.pump(0.11)
    with pytest.raises(StaleValueError):
        _ = ready.spool_position


def test_set_points_are_sent_at_once(ready, expected_protocol):
    # Fractions of 0x4000 = 16384; the control word is still 0.
    with expected_protocol([("201#00.00.00.20", None), ("201#00.00.00.C0", None)]):
        ready.spool_setpoint = 0.5
        ready.spool_setpoint = -1.0
    assert ready.spool_setpoint == -1.0


@pytest.mark.parametrize("fraction", [1.01, -1.01, float("nan"), float("inf")])
def test_a_set_point_out_of_range_is_refused_and_not_sent(ready, bus, fraction):
    before = len(bus.sent)
    with pytest.raises(ValueError, match="a fraction from -1 to 1"):
        ready.spool_setpoint = fraction
    assert (len(bus.sent), ready.spool_setpoint) == (before, 0.0)


def test_enable_repeats_its_command_until_the_valve_is_active(ready, upload, expected_protocol):
    steps = [
        ("201#07.00.00.00", None),
        status(upload, 0b1011),
        ("201#07.00.00.00", None),
        status(upload, 0b1111),
    ]
    with expected_protocol(steps):
        ready.enable()


@pytest.mark.parametrize(
    ("verb", "control_word", "word"), [("hold", "03", 0b1011), ("disable", "01", 0b1001)]
)
def test_leaving_active_takes_the_set_point_back(
    ready, upload, expected_protocol, verb, control_word, word
):
    ready.spool_setpoint = 0.5
    steps = [(f"201#{control_word}.00.00.00", None), status(upload, word)]
    with expected_protocol(steps):
        getattr(ready, verb)()
    assert ready.spool_setpoint == 0.0


def test_enable_tells_a_fault_with_its_emergency(ready, upload, bus, expected_protocol):
    bus.play("081#50.82.11.00.00.00.00.00", "081#00.00.00.00.00.00.00.00")
    with (
        expected_protocol([("201#07.00.00.00", None), status(upload, 0b0011)]),
        pytest.raises(DeviceFaultError) as caught,
    ):
        ready.enable()
    assert caught.value.code == 0x8250
    assert str(caught.value) == (
        "node 1: valve in FAULT_HOLD after emergency 0x8250, RPDO time-out"
    )


def test_enable_gives_up_in_time_and_says_where_the_valve_is(ready, upload, bus, expected_protocol):
    bus.play("701#7F")
    begin = bus.now()
    # One try each 5 ms: the fifth, over at 25 ms, is the first that ends after the 22 ms.
    with (
        expected_protocol([("201#07.00.00.00", None), status(upload, 0b1000)] * 5),
        pytest.raises(
            DriverTimeoutError,
            match=r"not ACTIVE within 0\.022 s: it is INIT, in NMT state PRE_OPERATIONAL",
        ),
    ):
        ready.enable(timeout=0.022)
    assert bus.now() - begin == pytest.approx(0.025)


def test_reset_fault_gives_the_device_an_edge(ready, upload, expected_protocol):
    steps = [
        status(upload, 0b0011),
        ("201#01.00.00.00", None),
        ("201#09.00.00.00", None),
        status(upload, 0b1001),
        ("201#01.00.00.00", None),
    ]
    with expected_protocol(steps):
        ready.reset_fault()


def test_a_fault_that_stays_is_told(ready, upload, expected_protocol):
    edge = [("201#01.00.00.00", None), ("201#09.00.00.00", None)]
    with (
        expected_protocol([status(upload, 0b0001), *edge, status(upload, 0b0001)]),
        pytest.raises(DeviceFaultError, match="FAULT_DISABLED, no emergency message"),
    ):
        ready.reset_fault(timeout=0.008)


def test_check_active(ready, network, bus):
    bus.play("181#0F.00.00.00")
    network.pump()
    ready.check_active()
    bus.play("181#0B.00.00.00")
    network.pump()
    with pytest.raises(DeviceFaultError, match="valve in HOLD"):
        ready.check_active()


def test_close_disables_the_valve_and_its_watches(ready, upload, download, expected_protocol):
    steps = [
        ("201#01.00.00.00", None),
        status(upload, 0b1001),
        upload(1, "1400.01", "01.02.00.00"),
        upload(1, "1400.05", "64.00"),
        download(1, "1400.01", "01.02.00.80"),
        download(1, "1400.05", "00.00"),
        download(1, "1400.01", "01.02.00.00"),
        download(1, "1016.01", "00.00.00.00"),
    ]
    with expected_protocol(steps), ready:
        pass


def test_close_of_a_lost_valve_raises_nothing(ready, caplog):
    with caplog.at_level(logging.WARNING):
        ready.close()  # nobody answers
    assert [record.message[:30] for record in caplog.records] == [
        "node 1: could not be disabled:",
        "node 1: could not be left unwa",
    ]


def test_close_of_a_valve_in_a_fault_state_is_no_warning(
    ready, expected_protocol, upload, download, caplog
):
    steps = [
        ("201#01.00.00.00", None),
        status(upload, 0b0011),  # FAULT_HOLD
        upload(1, "1400.01", "01.02.00.00"),
        upload(1, "1400.05", "00.00"),
        download(1, "1016.01", "00.00.00.00"),
    ]
    with caplog.at_level(logging.INFO), expected_protocol(steps):
        ready.close()
    (record,) = caplog.records
    assert record.levelno == logging.INFO
    assert "FAULT_HOLD" in record.message


def test_close_without_setup_sends_nothing(valve, bus):
    valve.close()
    assert bus.sent == []


def test_a_valve_on_rpdo4_and_tpdo4_with_a_pressure_set_point(
    network, bus, edit_eds, expected_protocol, upload, download
):
    """The mapping of Moog's ACV: RPDO4 6040 6300.01 6380.01, TPDO4 6041 6301.01."""
    eds = moog_like(edit_eds)
    valve = ProportionalValve(network, 1, eds)
    steps = [
        upload(1, "1000.00", "98.01.00.00"),
        upload(1, "1018.02", "08.04.00.00"),
        upload(1, "1A03.00", "02"),
        upload(1, "1A03.01", "10.00.41.60"),
        upload(1, "1A03.02", "10.01.01.63"),
        upload(1, "1803.01", "81.04.00.40"),
        upload(1, "1803.02", "01"),
        upload(1, "1803.05", "00.00"),
        download(1, "1017.00", "64.00"),
        upload(1, "6311.01", "00.20"),
        upload(1, "1603.00", "03"),
        upload(1, "1603.01", "10.00.40.60"),
        upload(1, "1603.02", "10.01.00.63"),
        upload(1, "1603.03", "10.01.14.63"),
        upload(1, "6314.01", "34.12"),  # what the device holds is what we go on sending
        download(1, "6042.00", "01"),
        upload(1, "1403.01", "01.05.00.00"),
        upload(1, "1403.05", "64.00"),
        download(1, "1016.01", "00.00.00.00"),
    ]
    with expected_protocol(steps):
        valve.setup()
    with expected_protocol([("501#00.00.00.10.34.12", None)]):
        valve.spool_setpoint = 0.5  # of the reference 0x2000
    bus.play("481#0F.00.00.F0")  # 0xF000 = -4096
    network.pump()
    assert (valve.state, valve.spool_position) == (ValveState.ACTIVE, -0.5)


def moog_like(edit_eds):
    """Moves RPDO1 and TPDO1 of our valve's EDS to RPDO4 and TPDO4."""
    eds = edit_eds(
        VALVE_408,
        {
            "1400sub1": "$NODEID+0x500",
            "1600sub0": 3,
            "1600sub3": "0x63140110",
            "1800sub1": "$NODEID+0x40000480",
        },
    )
    text = eds.read_text()
    for base in ("140", "160", "180", "1A0"):
        text = text.replace(f"[{base}0", f"[{base}3").replace(f"=0x{base}0\n", f"=0x{base}3\n")
    eds.write_text(text)
    return eds


@pytest.mark.parametrize(
    ("defaults", "message"),
    [
        ({"1A00sub0": 1}, r"no TPDO .* carries 0x6301\.01"),
        ({"1600sub0": 1}, r"no RPDO .* carries 0x6300\.01"),
        ({"1A00sub1": "0x63010110"}, "no TPDO .* carries 0x6041"),
    ],
)
def test_an_eds_that_maps_too_little_is_refused(network, edit_eds, defaults, message):
    with pytest.raises(DeviceMismatchError, match=message):
        ProportionalValve(network, 1, edit_eds(VALVE_408, defaults))


# What the valve's driver refuses before it says anything on the bus, and which fault it tells.


@pytest.mark.parametrize("seconds", [-0.001, 65.536, float("nan"), float("inf")])
def test_a_time_that_16_bits_of_milliseconds_cannot_hold_is_refused_at_once(valve, bus, seconds):
    with pytest.raises(ValueError, match="command time-out"):
        valve.setup(command_timeout=seconds)
    assert bus.sent == []


def test_of_several_emergencies_the_last_one_is_told(valve, network, bus):
    bus.play(
        "081#50.82.11.00.00.00.00.00",  # 8250
        "081#30.81.11.00.00.00.00.00",  # 8130
        "081#00.00.00.00.00.00.00.00",  # error reset
    )
    network.pump()
    error = valve._fault(ValveState.FAULT_HOLD)
    assert error.code == 0x8130
    assert "after emergency 0x8130" in str(error)


# A valve that somebody else has set up: the driver commands it with what its EDS file says.


def test_the_reference_value_is_that_of_the_eds_file_until_setup_reads_it(network, bus):
    valve = ProportionalValve(network, 1)
    valve.spool_setpoint = 0.5
    # Control word 0 and, as 0x6311.01 of our EDS file is 0x4000, a set-point of 0x2000.
    assert bus.sent == ["201#00.00.00.20"]
