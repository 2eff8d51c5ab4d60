"""The twin beside a machine that the virtual bench plays, on the frames of its bus."""

import can
import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.recording.frames import message_of
from hil_bench.abilities.shadow.twin import Shadow
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantState,
    ReducedOrderPlant,
    Solver,
    paper_parameters,
)
from hil_drivers import Network, PositionSensor, ProportionalValve

SETPOINTS = (0.5, -0.6, 0.0, 0.8, -0.7, 0.35)  # each for 0.3 s, well within the stroke


def machine_frames(config, *, fault="", is_synchronous=False):
    """Return the frames of a machine whose valve a controller moves to and fro."""
    with VirtualBench(config) as machine, Network(machine.bus, clock=machine.now) as network:
        machine.pump = network.pump
        for node in config.nodes:
            network.add_node(node.node_id, node.eds)
        valve = ProportionalValve(network, node_id=1)
        valve.setup(transmission_type=254, event_timer=0.005, command_timeout=0.0)
        if is_synchronous:
            PositionSensor(network, node_id=4).setup(transmission_type=1)
        network.start_node()
        valve.enable()
        for number, setpoint in enumerate(SETPOINTS):
            if fault and number == 3:
                getattr(machine.faults, fault)("valve")
            valve.spool_setpoint = setpoint
            for _ in range(30):
                if is_synchronous:
                    network.send(0x80, b"")
                machine.run(0.01)
        return [message_of(logged) for logged in machine.frames]


@pytest.fixture(scope="module")
def sound():
    """The frames of a sound machine, which nobody changes."""
    return tuple(machine_frames(load_config()))


def follow(frames, config):
    shadow = Shadow(config, horizon=0.25)
    for message in frames:
        shadow.take(message)
    shadow.finish()
    return list(shadow.windows)


def worst(windows, quantity):
    return max(window.residuals[quantity].rms for window in windows)


@pytest.mark.long
def test_the_twin_of_a_sound_machine_stays_beside_it(sound):
    config = load_config()
    windows = follow(sound, config)

    assert len(windows) == 6  # in 1.8 s less 0.12 s of joining and settling, each 0.25 s
    assert all(
        window.residuals[quantity].count > 10
        for window in windows
        for quantity in Shadow(config).units
    )
    # A tick that came late would be 0.2 mm at 0.2 m/s.
    assert worst(windows, "position") < 0.05e-3
    assert worst(windows, "P_A") < 1e5
    assert worst(windows, "P_B") < 1e5


def test_a_machine_with_other_ticks_is_compared_at_the_time_of_its_frames(load_bench):
    windows = follow(machine_frames(load_bench("[bench]\ntick_us = 700\n")), load_config())

    # In the first window the piston runs at 0.1 m/s, which is 0.1 mm in a tick of the twin; in the
    # others, too, a set-point acts as much as a tick early or late.
    assert windows[0].residuals["position"].rms < 0.02e-3
    assert worst(windows, "position") < 0.2e-3


def test_a_synchronous_value_is_of_the_time_of_its_sync():
    config = load_config()
    frames = machine_frames(config, is_synchronous=True)
    for message in frames:
        if message.arbitration_id == 0x184:
            message.timestamp += 4e-3  # as behind the frames of many other nodes
    windows = follow(sorted(frames, key=lambda message: message.timestamp), config)

    # 4 ms at 0.2 m/s would be 0.8 mm as soon as the set-point changes.
    assert len(windows) >= 6
    assert worst(windows, "position") < 0.05e-3


def test_faults_of_the_virtual_machine_are_not_the_twins(load_bench):
    faulty = load_bench('[[faults]]\nkind = "stick"\ntarget = "valve"\nat_s = 0.9\n')
    windows = follow(machine_frames(faulty), faulty)

    assert worst(windows, "spool_position") > 0.3


def test_a_sticking_spool_shows_in_the_spool_and_in_the_motion():
    config = load_config()
    windows = follow(machine_frames(config, fault="stick"), config)

    # From 0.9 s on the set-points are 80, -70 and 35 % off the 0 % at which the spool stays.
    late = [window for window in windows if window.begin > 0.9]
    assert worst(late, "spool_position") > 0.3
    # 80 % and 35 % are 0.74 and 0.155 mm of orifice (1.3 mm less 0.3 mm of dead-zone): some
    # 200 and 45 mm/s that the machine does not make.
    assert worst(late, "position") > 5e-3


def test_a_leak_shows_in_the_motion_under_load(load_bench):
    loaded = "[plant.axis1]\nload_n = 20000\n"
    sound = load_bench(loaded)
    leaking = load_bench(loaded + "internal_leakage_l_min_bar = 0.05\n")
    without = follow(machine_frames(sound), sound)
    windows = follow(machine_frames(leaking), sound)

    # 20 kN on 48.5 cm² are 41 bar, so 2.1 l/min leak past the piston: 7 mm/s, 1.8 mm in 0.25 s,
    # whose RMS is 1 mm.
    assert worst(without, "position") < 0.4e-3
    assert 0.7e-3 < worst(windows, "position") < 2e-3


def test_frames_of_others_and_silence_do_no_harm(sound):
    garbage = [
        can.Message(timestamp=0.5, arbitration_id=0x1234567, is_extended_id=True, data=b"abc"),
        can.Message(timestamp=0.5, is_error_frame=True),
        can.Message(timestamp=0.5, arbitration_id=0x182, is_extended_id=False, data=b"\x01"),
        can.Message(
            timestamp=0.5, arbitration_id=0x184, is_extended_id=False, is_remote_frame=True
        ),
    ]
    later = [can.Message(**{**_fields(m), "timestamp": m.timestamp + 100.0}) for m in sound]
    shadow = Shadow(load_config(), horizon=0.25)
    for message in (*sound[: len(sound) // 2], *garbage, *later):
        shadow.take(message)

    # Windows go on after the pause, and none spans it.
    assert any(window.begin > 50.0 for window in shadow.windows)
    assert all(window.end - window.begin < 0.3 for window in shadow.windows)
    assert worst(list(shadow.windows), "position") < 0.5e-3


def test_without_sensors_there_is_nothing_to_compare(sound):
    frames = [m for m in sound if m.arbitration_id != 0x182]
    assert follow(frames, load_config()) == []


def test_samples_are_what_was_measured_beside_the_twin(sound):
    shadow = Shadow(load_config(), horizon=0.25)
    for message in sound:
        shadow.take(message)
    positions = [sample for sample in shadow.samples if sample.quantity == "position"]
    assert positions == sorted(positions)
    # 50, -60, 80 % are 0.35, -0.48, 0.74 mm of orifice; 0.7 mm make +0.204 or -0.198 m/s (steady,
    # design notes): 0.3 s of each make 30.6 - 40.7 + 64.7 = 54.6 mm.
    assert max(sample.machine for sample in positions) == pytest.approx(0.0546, rel=0.03)
    assert all(abs(sample.machine - sample.twin) < 2e-3 for sample in positions)


@pytest.mark.parametrize("solver", Solver)
def test_a_restarted_plant_is_a_new_one_in_that_state(solver):
    parameters = paper_parameters()
    state = PlantState(0.05, 0.1, 6e6, 4e6, 4e-4, 0.0)
    for model in (FullOrderPlant, ReducedOrderPlant):
        plant = model(parameters, solver=solver, dt=2e-5)
        plant.step(PlantInput(1e-3), 500)
        plant.restart(state)
        fresh = model(parameters, solver=solver, dt=2e-5, state=state)
        assert plant.output == fresh.output
        assert plant.step(PlantInput(5e-4), 100) == fresh.step(PlantInput(5e-4), 100)
        with pytest.raises(ParameterError, match=r"x = 0\.3 m: must lie between the end stops"):
            plant.restart(state._replace(x=0.3))


def _fields(message):
    return {
        "arbitration_id": message.arbitration_id,
        "is_extended_id": message.is_extended_id,
        "is_remote_frame": message.is_remote_frame,
        "data": message.data,
    }
