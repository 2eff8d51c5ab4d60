"""`hil-bench run` on python-can's virtual bus, with a clock that jumps."""

import itertools
import json
import re
import socket

import can
import pytest
from support.tables import from_text

from device_profiles import IMITATIONS
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.cli import main
from hil_bench.cli.status_line import Progress
from hil_bench.outside.realtime.clock import VirtualClock

BUS = ["-i", "virtual", "-c", "test_run"]


@pytest.fixture(autouse=True)
def _virtual_time(monkeypatch):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", VirtualClock)


def test_it_introduces_itself_runs_and_sums_up(cli):
    out, err = cli(["run", *BUS, "--duration", "0.25"])
    assert out.startswith(
        "bench  built-in bench, 1000 Hz, 20 plant steps a tick\nbus    virtual test_run\n\nnode 1"
    )
    assert "ticks     250 of 1000 us, 0 overran, 0 skipped\n" in out
    assert "frames    0 received (0 for nobody here), 4 sent\n" in out  # four boot-up messages
    assert out.endswith("node 4    position: PRE-OPERATIONAL\n")
    assert err == ""


@pytest.fixture
def io_alone(tmp_path):
    """A file with a module made from its EDS file, and no axis."""
    path = tmp_path / "io.toml"
    eds = IMITATIONS / "analogue_io_401.eds"
    path.write_text(f'[nodes.io]\nnode_id = 10\neds = "{eds}"\n')
    return path


def test_a_bench_without_an_axis_runs_and_is_recorded_and_drawn(io_alone, tmp_path, cli):
    recording = tmp_path / "run.mf4"
    words = ["--duration", "0.05", "--record", str(recording), str(io_alone)]
    out = cli(["run", *BUS, *words]).out
    assert out.startswith(f"bench  {io_alone}, 1000 Hz, no axis\n")
    assert "ticks     50 of 1000 us, 0 overran, 0 skipped\n" in out
    assert f"recorded  50 rows, 1 frames: {recording}\n" in out  # the boot-up message
    assert main(["plot", str(recording)]) == 0  # the traffic
    assert recording.with_suffix(".png").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--speed", "max"],
        ["analyse", "linearisation"],
        ["identify", "x.csv"],
        ["shadow", *BUS],
    ],
)
def test_what_needs_an_axis_says_so(io_alone, tmp_path, monkeypatch, words, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*words, str(io_alone)]) == 2
    right = f"{io_alone}:plant: the bench has no axis; give it one, as [plant.axis1]\n"
    assert capsys.readouterr().err == f"hil-bench: error: {right}"


def test_what_is_hard_to_believe_is_said_once(make_file, cli):
    path = make_file("bench.toml", "[plant.axis1]\nsupply_pressure_bar = 2000\n")
    said = cli(["run", str(path), *BUS, "--duration", "0.01"]).err.splitlines()
    line, consequence = [line for line in said if "warning" in line]
    assert "plant.axis1: largest acceleration is" in consequence
    # 2000 bar of 1e5 Pa each are 200 MPa.
    assert line.startswith(
        f"hil-bench: warning: {path}:plant.axis1.supply_pressure_bar: 2000 is 200 MPa; 5 to 1000 is"
    )


def test_it_says_join_when_the_nodes_have_booted(monkeypatch, capsys):
    """`print` itself is left alone, since Numba looks it up where it is imported here first."""
    printed, sent = [], []

    def note(_self, frames):
        printed.append(capsys.readouterr().out)
        sent.extend(frames)

    monkeypatch.setattr("hil_bench.outside.transports.opening.PythonCanTransport.send", note)
    assert main(["run", *BUS, "--duration", "0.01"]) == 0
    assert [frame.can_id for frame in sent[:4]] == [0x701, 0x702, 0x703, 0x704]
    assert printed[0] == ""
    assert "".join([*printed, capsys.readouterr().out]).startswith("bench  built-in bench")


class SlowClock(VirtualClock):
    """Each look at it costs 2 ms, so that every tick of 1 ms overruns."""

    def now(self):
        self.advance(2_000_000)
        return super().now()


def test_strict_timing_fails_on_an_overrun(monkeypatch, cli):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", SlowClock)
    assert "10 overran" in cli(["run", *BUS, "--duration", "0.01", "--strict-timing"], 4).out
    assert main(["run", *BUS, "--duration", "0.01"]) == 0


def test_an_overrun_stops_it_where_that_is_wanted(monkeypatch, cli):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", SlowClock)
    out, err = cli(["run", *BUS, "--duration", "1", "--overrun", "stop"], 4)
    assert "ticks     101 of 1000 us, 101 overran" in out  # the first 100 are forgiven
    assert err.startswith("hil-bench: error: tick 101 ended ")


def test_ticks_that_are_skipped_count_towards_the_duration(monkeypatch, capsys):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", SlowClock)
    assert main(["run", *BUS, "--duration", "0.1", "--overrun", "skip"]) == 0
    ticks, skipped = re.search(r"ticks +(\d+) .* (\d+) skipped", capsys.readouterr().out).groups()
    assert int(skipped) > 0
    assert 100 <= int(ticks) + int(skipped) <= 110


def test_the_histograms_are_for_programs(tmp_path):
    path = tmp_path / "timing.json"
    assert main(["run", *BUS, "-b", "100000", "--duration", "0.02", "--histograms", str(path)]) == 0
    timing = json.loads(path.read_text())
    assert (timing["ticks"], timing["overruns"], timing["tick_us"]) == (20, 0, 1000)
    assert timing["lateness"]["bins"] == [{"to_us": 0.0, "count": 20}]  # the clock jumps
    assert timing["work"]["p99_us"] == 0.0
    assert timing["frames"]["sent"] == 4
    assert round(timing["bus_load"], 3) == 0.120
    assert timing["ended_by"] is None


def test_a_file_that_cannot_be_written_is_told_before_the_bus_is_opened(tmp_path, capsys):
    assert main(["run", *BUS, "--histograms", str(tmp_path / "no" / "file")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_a_run_that_cannot_begin_leaves_the_files_of_the_run_before(tmp_path, make_file, cli):
    """Neither without a bus nor with a port of its server in use."""
    files = tmp_path / "run.csv", tmp_path / "timing.json"
    words = ["--duration", "0.02", "--record", str(files[0]), "--histograms", str(files[1])]
    cli(["run", *BUS, *words])
    before = [path.read_bytes() for path in files]
    assert "no CAN interface chosen" in cli(["run", *words], 3).err
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        modbus = make_file("b.toml", f"[modbus]\nhost = '127.0.0.1'\nport = {port}\n")
        assert "in use" in cli(["run", str(modbus), *BUS, *words], 3).err
    assert [path.read_bytes() for path in files] == before
    cli(["run", *BUS, *words])
    assert len(before[1].splitlines()) == len(files[1].read_text().splitlines())


def test_the_bus_load_is_told(capsys):
    # Four boot-up messages of one byte: 55 bits and (42 - 1) / 4 / 2 stuff bits each, 240.5 in all;
    # in 20 ms at 100 kbit/s there is room for 2000.
    assert main(["run", *BUS, "-b", "100000", "--duration", "0.02"]) == 0
    assert "\nbus load  12.0% of 100 kbit/s\n" in capsys.readouterr().out


def test_the_present_load_is_right_at_the_first_look(tmp_path, cli, monkeypatch):
    """A heartbeat is 55 bits and (42 - 1) / 4 / 2 stuff bits: 100 of them are 6 % of 100 kbit/s."""

    class OneLook(Progress):
        def look(self, now):
            if now == 1_500_000_000:
                self._say("  ".join(self._lines(now)))

    monkeypatch.setattr("hil_bench.cli.status_line.Progress", OneLook)
    path = tmp_path / "bench.toml"
    path.write_text(
        '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n[nodes.valve.objects]\n"0x1017" = 10\n'
    )
    assert "bus 6.0 %" in cli(["run", str(path), *BUS, "-b", "100000", "--duration", "1.6"]).err


def test_a_wish_to_stop_ends_it_with_130(monkeypatch):
    monkeypatch.setattr("hil_bench.cli.exit_codes.Interruption.requested", True, raising=False)
    monkeypatch.setattr("hil_bench.cli.exit_codes.Interruption.__init__", lambda _self: None)
    assert main(["run", *BUS]) == 130


@from_text("arguments", "message")
def test_arguments_that_cannot_be_meant(arguments, message, cli):
    assert cli(["run", *arguments.split()], 2).err == f"hil-bench: error: {message}\n"


def test_a_hub_is_hosted_and_joined(cli):
    out = cli("run --hub 0 --duration 0.05").out
    assert "\nbus    socketcand can0\n" in out
    assert "\njoin   -i socketcand -c can0 --bus-kwargs host=127.0.0.1 port=" in out


@pytest.mark.parametrize(
    ("words", "limit"),
    [
        ([], 1e6),
        (["-b", "250000"], 250e3),
        (["-b", "250000", "--speed", "2"], 500e3),  # whose bus is twice as fast, too
        (["--speed", "max"], None),
        (["--hub-unlimited"], None),
    ],
)
def test_a_hub_limits_its_clients_to_the_bit_rate(monkeypatch, words, limit):
    made = []

    class Hub(HubProcess):
        def __init__(self, **options):
            super().__init__(**options)
            made.append(options["bitrate"])

    monkeypatch.setattr("hil_bench.abilities.hub.hosting.HubProcess", Hub)
    assert main(["run", "--hub", "0", "--duration", "0.01", *words]) == 0
    assert made == [limit]


def test_a_system_clock_that_is_set_back_holds_nothing_up(monkeypatch, capsys):
    clock = itertools.count(1_700_000_000, -3600)  # an hour less at each look
    monkeypatch.setattr("can.bus.time", lambda: next(clock))
    for name in ("time", "time_ns"):
        monkeypatch.setattr(f"time.{name}", lambda: next(clock))
    assert main(["run", "--hub", "0", "--duration", "0.05"]) == 0
    assert "ticks     50 of 1000 us, 0 overran, 0 skipped\n" in capsys.readouterr().out


def test_its_speed_is_that_of_the_clock_times_a_factor(monkeypatch, capsys):
    clock = VirtualClock()
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", lambda: clock)
    assert main(["run", *BUS, "--duration", "1", "--speed", "0.5"]) == 0
    assert "ticks     1000 of 1000 us, 0 overran, 0 skipped\n" in capsys.readouterr().out
    assert clock.now() == pytest.approx(2e9, rel=2e-3)  # [ns], a tick more or less


def test_at_full_speed_it_looks_at_no_clock_and_records_every_tick(monkeypatch, cli, tmp_path):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", None)
    path = tmp_path / "run.csv"
    words = ["--duration", "2", "--speed", "max", "--record", str(path)]
    out = cli(["run", *BUS, *words]).out
    assert "ticks     2000 of 1000 us, 0 overran, 0 skipped\n" in out
    assert f"recorded  2000 rows: {path}\n" in out
    assert "lateness" not in out
    assert len(read_recording(path)) == 2000


def test_faults_are_announced(cli):
    words = ["--fault", "freeze", "pressure_a", "at_s=2", "for_s=1", "--fault", "stick", "valve"]
    text = cli(["run", *BUS, "--duration", "0.02", *words]).out
    assert "fault  freeze pressure_a at 2 s, for 1 s\nfault  stick valve at 0 s\n" in text
    assert "fault     0.000 s stick valve begins\n" in text  # in the summary


def test_a_fault_of_what_is_not_there_is_told(capsys):
    assert main(["run", *BUS, "--fault", "freeze", "valve"]) == 2
    assert '"valve" is no sensor; give one of pressure_a' in capsys.readouterr().err


def test_modbus_is_served_beside_the_bus(make_file, cli):
    path = make_file("bench.toml", '[modbus]\nport = 0\nserial_port = "pty"\n')
    out = cli(["run", str(path), *BUS, "--duration", "0.02"]).out
    assert re.search(r"^modbus TCP 127\.0\.0\.1:\d+$", out, re.MULTILINE)
    assert re.search(r"^modbus RTU /dev/\S+$", out, re.MULTILINE)
    assert "units  2 pressure_a, 3 pressure_b, 4 position\n" in out


def test_a_modbus_port_in_use_is_one_line_and_3(make_file, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        path = make_file("bench.toml", f"[modbus]\nport = {port}\n")
        assert main(["run", str(path), *BUS, "--duration", "0.02"]) == 3
    assert capsys.readouterr().err == (
        f"hil-bench: error: modbus 127.0.0.1:{port}: the port is in use; "
        "give another port, or end the program that has it\n"
    )


TWO_BUSES = """
[bus]
interface = "virtual"
channel = "test_run"
[buses.sensors]
interface = "virtual"
channel = "test_run_2"
[nodes]
valve = { profile = "valve_408", node_id = 1 }
position = { profile = "encoder_406", bus = "sensors", node_id = 1 }
"""


def test_a_bench_on_two_buses_opens_and_counts_both(make_file, capsys):
    path = make_file("bench.toml", TWO_BUSES)
    with can.Bus(interface="virtual", channel="test_run_2") as sensors:
        assert main(["run", str(path), "--duration", "0.05"]) == 0
        assert sensors.recv(0).arbitration_id == 0x701  # its boot-up message
    out = capsys.readouterr().out
    assert "bus    bus: virtual test_run\nbus    sensors: virtual test_run_2\n" in out
    assert "node 1  position  encoder_406  axis1  on sensors\n" in out
    assert "          bus: 0 received, 1 sent\n          sensors: 0 received, 1 sent\n" in out
    assert "of 2 Mbit/s" in out


def test_a_hub_has_a_channel_for_each_bus(make_file, cli):
    path = make_file("bench.toml", TWO_BUSES)
    out = cli(["run", str(path), "--hub", "0", "--duration", "0.01"]).out
    port = re.search(r"port=(\d+)", out)[1]
    for name, channel in (("bus", "can0"), ("sensors", "can1")):
        assert f"bus    {name}: socketcand {channel}\n" in out
        flags = f"-i socketcand -c {channel} --bus-kwargs host=127.0.0.1 port={port}    ({name})"
        assert f"join   {flags}\n" in out
