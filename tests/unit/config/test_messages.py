# ruff: noqa: E501 - a mistake and its message on one line are easier to compare
"""Each mistake ends in one line that says where, what is wrong and what would be right."""

from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.config.values import describe

VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'

ONE_VALUE = [
    # Keys and tables that are not there
    ("[bench]\ntick = 1000", "bench.tick: unknown key; the nearest known key is tick_us"),
    ("[plant.axis1]\nStroke_MM = 1", "plant.axis1.Stroke_MM: unknown key; the nearest known key is stroke_mm"),
    ("[plants.axis1]", "plants: unknown table; the nearest known is [plant]"),
    ("tick_us = 1000\n[bench]", "tick_us: unknown table; the nearest known is [bus]"),
    ("bench = 3", "bench: 3 is not a table; write it as [bench]"),
    ("[plant]\nstroke_mm = 400", "plant.stroke_mm: 400 is not a table; write it as [plant.NAME]"),
    ("[[plant.axis1]]", "plant.axis1: an array is not a table; write it as [plant.NAME]"),
    ('[plant."a\\nb"]', 'plant: "a\\nb" cannot be a name; give at most 32 letters, digits, _ or -'),
    # Numbers
    ('[plant.axis1]\nstroke_mm = "400"', 'plant.axis1.stroke_mm: "400" is not a number; give a number in mm'),
    ("[plant.axis1]\nstroke_mm = true", "plant.axis1.stroke_mm: true is not a number; give a number in mm"),
    ("[plant.axis1]\nstroke_mm = nan", "plant.axis1.stroke_mm: nan is not finite; give a number in mm"),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = 1\npressure_source = -1', "nodes.v.pressure_source: -1 is not a name; give text in quotes"),
    ("[plant.axis1]\nsupply = []", 'plant.axis1.supply: an array is no supply; give "constant", "unit" or the name of a [supply.NAME]'),
    ("[plant.axis1]\nstroke_mm = inf", "plant.axis1.stroke_mm: inf is not finite; give a number in mm"),
    (f"[plant.axis1]\nstroke_mm = 1{'0' * 400}", f"plant.axis1.stroke_mm: 1{'0' * 17}...{'0' * 18} is not finite; give a number in mm"),
    ("[plant.axis1]\nstroke_mm = [1]", "plant.axis1.stroke_mm: an array is not a number; give a number in mm"),
    ("[plant.axis1]\nstroke_mm = {a = 1}", "plant.axis1.stroke_mm: a table is not a number; give a number in mm"),
    ("[plant.axis1]\nstroke_mm = 2026-11-21", "plant.axis1.stroke_mm: a date or time is not a number; give a number in mm"),
    ("[plant.axis1]\nspool_damping_ratio = false", "plant.axis1.spool_damping_ratio: false is not a number; give a number"),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = 1\nfull_opening_mm = 0', "nodes.v.full_opening_mm: 0 is out of range; give a number in mm from 0.001 to 1000"),
    # Integers
    ("[bench]\nseed = 1.5", "bench.seed: 1.5 is not an integer; give an integer from 0 up"),
    ("[bench]\nseed = -1", "bench.seed: -1 is out of range; give an integer from 0 up"),
    (f"[bench]\nseed = 0x1{'0' * 16}", f"bench.seed: {2**64} is out of range; give an integer from 0 to {2**63 - 1}"),
    ("[bench]\nseed = true", "bench.seed: true is not an integer; give an integer from 0 up"),
    ("[bench]\ntick_us = 0", "bench.tick_us: 0 is out of range; give an integer from 100 to 1000000"),
    ("[bench]\nstep_us = 0", "bench.step_us: 0 is out of range; give an integer from 1 to 10000"),
    ('[bench]\nrealtime = "rr"', 'bench.realtime: "rr" is unknown; give one of "off", "fifo", "deadline"'),
    ('[bench]\nrealtime_spin_us = 50', 'bench.realtime_spin_us: 50 needs a processor of its own; give realtime = "fifo" and realtime_cpu'),
    ('[bench]\nrealtime = "fifo"\nrealtime_cpu = 1\nrealtime_spin_us = 600', 'bench.realtime_spin_us: 600 is more than half of tick_us = 1000; give at most 500'),
    ('[bench]\nrealtime = "deadline"\nrealtime_cpu = 1', 'bench.realtime_cpu: 1 with realtime = "deadline", which Linux ties to no processor; leave realtime_cpu out, or give realtime = "fifo"'),
    ("[bus]\nbitrate = 2000000", "bus.bitrate: 2000000 is out of range; give an integer from 1 to 1000000"),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = 0', "nodes.v.node_id: 0 is out of range; give an integer from 1 to 127, or \"unconfigured\""),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = 128', "nodes.v.node_id: 128 is out of range; give an integer from 1 to 127, or \"unconfigured\""),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = "x"', 'nodes.v.node_id: "x" is not a node-ID; give an integer from 1 to 127, or "unconfigured"'),
    ('[nodes.v]\nprofile = "valve_408"\nnode_id = true', 'nodes.v.node_id: true is not a node-ID; give an integer from 1 to 127, or "unconfigured"'),
    # Points
    ("[plant.axis1]\nload_series_s_n = 3", "plant.axis1.load_series_s_n: 3 is not a list of points; give [[time, value], ...], each [s, N]"),
    ("[plant.axis1]\nload_series_s_n = [[1, 2], 3]", "plant.axis1.load_series_s_n: 3 is not a point; give [[time, value], ...], each [s, N]"),
    ("[plant.axis1]\nload_series_s_n = [[1, 2, 3]]", "plant.axis1.load_series_s_n: an array is not a point; give [[time, value], ...], each [s, N]"),
    ("[plant.axis1]\nload_series_s_n = [[0, nan]]", "plant.axis1.load_series_s_n: nan is not finite; give [[time, value], ...], each [s, N]"),
    ("[plant.axis1]\nload_series_s_n = [[true, 0]]", "plant.axis1.load_series_s_n: true is not a number; give [[time, value], ...], each [s, N]"),
    # Other kinds
    ("[plant.axis1]\nfriction = 'dahl'", 'plant.axis1.friction: "dahl" is unknown; give one of "stribeck", "lugre"'),
    ("[plant.axis1]\nend_stop = 1", "plant.axis1.end_stop: 1 is not a truth value; give true or false"),
    ('[bench]\nstep_us = 100\n[plant.axis1]\nsolver = "forward-euler"\nbulk_modulus_mpa = 1000', 'plant.axis1.solver: "forward-euler" is unstable with these parameters at step_us = 100; give solver = "linearly-implicit-midpoint" or bench.step_us = 14'),
    ('[plant.axis1]\nmodel = "reduced"\ntank_pressure_bar = 5', "plant.axis1.tank_pressure_bar: P_T = 500000 Pa; must be 0, for eqs. (14), (15) have no tank pressure"),
    # (P_S - 2 P_floor) times the mean area, (10 + 0.20265) MPa * 48.5 cm²
    ('[plant.axis1]\nmodel = "reduced"\nload_n = 50000', "plant.axis1.load_n: load at the start = 50000 N; must be within 49482.9 N, which the supply can hold in the reduced model"),
    ('[plant.axis1]\nmodel = "reduced"\nfriction = "lugre"', "plant.axis1.friction: the reduced model has no place for bristles; the full-order model is right"),
    ('[plant.axis1]\nmodel = "reduced"\nsupply = "unit"', "plant.axis1.supply: the reduced model has no place for supply_unit; the full-order model is right"),
    ('[plant.axis1]\nmodel = "reduced"\nspool_delay_ms = 5000', "plant.axis1.spool_delay_ms: delay = 5 s; must be 1 s or less"),
    ('[plant.axis1]\nmodel = "reduced"\nsolver = "forward-euler"\nbulk_modulus_mpa = 2000', 'plant.axis1.solver: "forward-euler" is unstable with these parameters at step_us = 50; give solver = "linearly-implicit-midpoint" or bench.step_us = 24'),
    ("[bench]\nstep_us = 1000\n[plant.axis1]\nmoving_mass_kg = 0.02\ncoulomb_friction_n = 0\nstatic_friction_n = 0\nviscous_friction_n_s_m = 0", 'plant.axis1.solver: "linearly-implicit-midpoint" cannot follow the piston\'s swing on the oil with these parameters at step_us = 1000; give bench.step_us = 38'),
    ("[plant.axis1]\nfriction = 'lugre'\nbristle_damping_n_s_m = 5000", "plant.axis1.bristle_damping_n_s_m: sigma_1 = 5000 N s/m; must be 4000 N s/m or less, sigma F_c / (F_s - F_c), or LuGre friction drives the piston (see also viscous_friction_n_s_m, coulomb_friction_n, static_friction_n)"),
    ("[plant.axis1]\nspool_delay_ms = 1", 'plant.axis1.spool_delay_ms: delay = 0.001 s; only for model = "reduced"'),
    ('[plant.axis1]\nsolver = "rk4"', 'plant.axis1.solver: "rk4" is unknown; give one of "forward-euler", "linearly-implicit-midpoint", "runge-kutta"'),
    ('[bus]\ninterface = "socketcn"', 'bus.interface: python-can has no interface "socketcn"; the nearest is "socketcan"'),
    ('[bus]\ninterface = "a\\u0000"', r'bus.interface: "a\u0000" has a NUL character, which no name and no path has'),
    ('[bus]\ninterface = ""', 'bus.interface: "" is not a name; give text in quotes'),
    ("[bus]\nchannel = 1.5", 'bus.channel: 1.5 is not a channel; give text or a number, as in "can0"'),
    ('[bus]\nchanne = "can0"', "bus.channe: unknown key; the nearest known key is channel"),
    ("[bus]\nhosts = [1]", "bus.hosts: an array cannot be a bus option; give text, a number or a truth value"),
    # Nodes
    ("[nodes.v]\nnode_id = 1", 'nodes.v.profile: missing; give for example profile = "valve_408", or eds = "vendor.eds" for a device made from that file alone'),
    ('[nodes.v]\nprofile = "valve_408"', "nodes.v.node_id: missing; give for example node_id = 1"),
    ('[nodes.v]\nprofile = "valve"\nnod = 1', 'nodes.v.profile: "valve" is unknown; give one of "valve_408", "pressure_404", "transducer_404", "encoder_406", "encoder_redundant_406", "rotary_encoder_406", "drive_402", "generic"'),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2', 'nodes.p.source: missing; give for example source = "P_A"'),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_S"', 'nodes.p.source: "P_S" is unknown; give one of "P_A", "P_B"'),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\nspan_bar = 250', "nodes.p.span_bar: 250 is not a range; give [start, end] in bar, start below end"),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\nspan_bar = [250, 0]', "nodes.p.span_bar: [250, 0] is empty; give [start, end] in bar, start below end"),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\nspan_bar = [5, 5]', "nodes.p.span_bar: [5, 5] is empty; give [start, end] in bar, start below end"),
    ('[nodes.p]\nprofile = "pressure_404"\nnode_id = 2\nsource = "P_A"\nspan_bar = [0, "x"]', 'nodes.p.span_bar: "x" is not a number; give [start, end] in bar, start below end'),
    ('[nodes.e]\nprofile = "encoder_406"\nnode_id = 4\nspan_bar = [0, 1]', "nodes.e.span_bar: unknown key; the nearest known key is storage"),
]  # fmt: skip

TOGETHER = [
    ("[bench]\ntick_us = 1020", "bench.tick_us: 1020 is not a multiple of step_us = 50; give 1000 or 1050"),
    ("[bench]\nsync_period_us = 2500", "bench.sync_period_us: 2500 is not a multiple of tick_us = 1000; give 2000 or 3000"),
    ("[bench]\ntick_us = 100\nstep_us = 300", "bench.tick_us: 100 is not a multiple of step_us = 300; give 300"),
    (f'{VALVE}[nodes.e]\nprofile = "encoder_406"\nnode_id = 1', "nodes.e.node_id: 1 is taken by nodes.valve; 2 is free"),
    (f'{VALVE}axis = "lift"', 'nodes.valve.axis: there is no axis "lift"; give one of axis1'),
    (f'{VALVE}axis = "a\\nb"', 'nodes.valve.axis: there is no axis "a\\nb"; give one of axis1'),
    (f"[plant.a]\n[plant.b]\n{VALVE}", "nodes.valve.axis: missing; give one of a, b"),
    ('[nodes.e]\nprofile = "encoder_406"\nnode_id = 4', 'plant.axis1: has no valve; give it a node with profile = "valve_408" and axis = "axis1", or bind an object with sink = "axis1.spool_setpoint"'),
    (f'{VALVE}[nodes.v2]\nprofile = "valve_408"\nnode_id = 2', "nodes.v2.axis: axis1 has the valve nodes.valve already; give each axis one valve or one sink"),
    (f'{VALVE}eds = "no.eds"', "nodes.valve.eds: there is no file no.eds; give the path of an EDS file"),
    (f'{VALVE}storage = "bench.toml"', "nodes.valve.storage: bench.toml is no folder; give the path of one, which may be new"),
    ('[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\nserial_number = 4294967296', "nodes.valve.serial_number: 4294967296 is out of range; give an integer from 0 to 4294967295"),
    (f'{VALVE}[nodes.a]\nprofile = "encoder_406"\nnode_id = 2\nserial_number = 1\n[nodes.b]\nprofile = "encoder_406"\nnode_id = 3\nserial_number = 1', "nodes.b.serial_number: 1 is that of nodes.a too; give each device of a kind its own"),
    # Physical sense is the plant's to judge; the key is the one that the user wrote.
    ("[plant.axis1]\nbulk_modulus_mpa = -1", "plant.axis1.bulk_modulus_mpa: E = -1e+06 Pa; must be greater than 0"),
    ("[plant.axis1]\nmoving_mass_kg = 0", "plant.axis1.moving_mass_kg: m = 0 kg; must be greater than 0"),
    ("[plant.axis1]\nstroke_mm = -1", "plant.axis1.stroke_mm: h = -0.0005 m; must be greater than 0"),
    ("[plant.axis1]\ntank_pressure_bar = 120", "plant.axis1.supply_pressure_bar: P_S = 1e+07 Pa; must be greater than P_T = 1.2e+07 Pa (see also tank_pressure_bar)"),
    ("[plant.axis1]\nend_stop_stiffness_n_mm = -1", "plant.axis1.end_stop_stiffness_n_mm: stiffness of the end stop = -1000 N/m; must be greater than 0"),
    ("[plant.axis1]\ncavitation_floor_bar = 1", "plant.axis1.cavitation_floor_bar: cavitation_floor = 100000 Pa; must be 0 or less, as a gauge pressure (absolute vacuum is -101325 Pa)"),
    ("[plant.axis1]\nentrained_air_percent = 60", "plant.axis1.entrained_air_percent: air_fraction = 0.6; must be at most 0.5, or it is foam"),
    ("[plant.axis1]\nspool_overlap_negative_mm = -1", "plant.axis1.spool_overlap_negative_mm: beta_negative = -0.001 m; must be 0 or greater"),
    ("[plant.axis1]\nfriction = 'lugre'\nbristle_stiffness_n_mm = 0", "plant.axis1.bristle_stiffness_n_mm: sigma_0 = 0 N/m; must be greater than 0"),
    ("[plant.axis1]\nsupply = 'unit'\naccumulator_volume_l = 1\naccumulator_precharge_bar = 100", "plant.axis1.accumulator_precharge_bar: precharge_pressure = 1e+07 Pa; must be below relief_pressure = 1e+07 Pa, or the accumulator never fills (see also relief_pressure_bar)"),
    ("[plant.axis1]\nload_mass_kg = 10\nload_slope_deg = 100", "plant.axis1.load_slope_deg: slope = 1.74533 rad; must lie between -pi/2 and pi/2"),
    ("[plant.axis1]\nload_spring_n_mm = -2", "plant.axis1.load_spring_n_mm: spring_stiffness = -2000 N/m; must be greater than 0"),
    ("[plant.axis1]\nload_series_s_n = [[1, 0], [0, 0]]", "plant.axis1.load_series_s_n: load_series = 0 s after 1 s; its times must not decrease"),
    ("[plant.axis1]\nposition_mm = 250", "plant.axis1.position_mm: 250 is beyond the stroke; give -200 to 200, half of stroke_mm to each side"),
]  # fmt: skip


def test_a_mistake_is_told_in_one_line(write):
    def said(text):
        with pytest.raises(ConfigError) as caught:
            load_config(write(text))
        return str(caught.value)

    rows = ONE_VALUE + TOGETHER
    told = [(text, said(text)) for text, _ in rows]
    assert told == [(text, f"bench.toml:{message}") for text, message in rows]


def test_several_mistakes_are_told_together(write):
    path = write("[bench]\ntick = 1\nseed = -1\n[plant.axis1]\nstroke_mm = true\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path)

    assert str(caught.value).splitlines() == [
        "bench.toml:bench.tick: unknown key; the nearest known key is tick_us",
        "bench.toml:bench.seed: -1 is out of range; give an integer from 0 up",
        "bench.toml:plant.axis1.stroke_mm: true is not a number; give a number in mm",
    ]


def test_a_bus_with_all_node_ids_taken_says_so(write):
    sensor = '[nodes.n{0}]\nprofile = "encoder_406"\nnode_id = {0}\n'
    extra = '[nodes.extra]\nprofile = "encoder_406"\nnode_id = 127\n'
    path = write(VALVE + "".join(sensor.format(n) for n in range(2, 128)) + extra)
    with pytest.raises(ConfigError) as caught:
        load_config(path)

    assert str(caught.value) == (
        "bench.toml:nodes.extra.node_id: 127 is taken by nodes.n127; a bus has room for 127 nodes"
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[bench\n", 'bench.toml: is not valid TOML: Expected \']\' at the end of a table declaration (at line 1, column 7); see https://toml.io'),
        (b"[bench]\n\ntick_us = 1 ms\n", "bench.toml: is not valid TOML: Expected newline or end of document after a statement (at line 3, column 13); see https://toml.io"),
        (b"[bench]\ntick_us =", "bench.toml: is not valid TOML: Invalid value (at end of document); see https://toml.io"),
        (b"# \xff\n", "bench.toml: is not UTF-8 text; save it as UTF-8"),
        (b"MDF     4.10\0\xff", "bench.toml: is no text; give a TOML file"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_toml_names_the_line(write, content, message):
    path = write("")
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_config(path)

    assert str(caught.value) == message


def test_a_file_without_an_end_is_refused():
    with pytest.raises(ConfigError, match=r"^/dev/zero: is larger than 16 MiB; give a TOML file$"):
        load_config(Path("/dev/zero"))


def test_a_byte_order_mark_as_windows_writes_it_is_no_part_of_the_text(write):
    path = write("")
    path.write_bytes(b"\xef\xbb\xbf[bench]\r\ntick_us = 2000\r\n")
    assert load_config(path).tick_ns == 2_000_000


@from_text("content", "sort")
def test_a_file_of_another_sort_is_one_line(write, content, sort):
    with pytest.raises(ConfigError) as caught:
        load_config(write(content))
    assert str(caught.value) == f"bench.toml: is {sort}; give a bench"


@pytest.mark.parametrize("part", ["a", '"a b"', "'a'", "1"])
def test_a_key_of_many_parts_is_refused(write, part):
    """Of 20,000 it would take 1.6 GiB to read them."""
    write(" . ".join([part] * 101) + " = 1\n")
    with pytest.raises(ConfigError, match=r"has a key of more than 100 parts; give shorter ones$"):
        load_config(Path("bench.toml"))


def test_deeply_nested_toml_is_refused(write):
    with pytest.raises(ConfigError, match=r"^bench.toml: is not valid TOML: "):
        load_config(write("a = " + "[" * 100_000))


def test_a_file_that_cannot_be_read_says_why(tmp_path):
    with pytest.raises(ConfigError) as missing:
        load_config(tmp_path / "no.toml")
    with pytest.raises(ConfigError) as directory:
        load_config(tmp_path)

    assert str(missing.value) == (
        f"{tmp_path}/no.toml: cannot be read: No such file or directory; give a TOML file"
    )
    assert str(directory.value) == f"{tmp_path}: cannot be read: Is a directory; give a TOML file"


@pytest.mark.parametrize("text", ["x", "-1", "1.5", "٣", "1_0"])
def test_a_bad_seed_in_the_environment_names_the_variable(monkeypatch, text):
    monkeypatch.setenv("HIL_BENCH_SEED", text)
    with pytest.raises(ConfigError) as caught:
        load_config()

    assert str(caught.value) == (
        f'environment:HIL_BENCH_SEED: "{text}" is not an integer; give an integer from 0 up'
    )


def test_a_bad_value_on_the_command_line_names_the_option():
    with pytest.raises(ConfigError) as caught:
        load_config(seed=-1, interface="socketcn", bus_options={"channe": "can0"})

    assert str(caught.value).splitlines() == [
        "--seed: -1 is out of range; give an integer from 0 up",
        "--bus-kwargs channe: unknown key; the nearest known key is channel",
        '--interface: python-can has no interface "socketcn"; the nearest is "socketcan"',
    ]


def test_long_names_that_differ_at_their_ends_stay_apart():
    alike = "an_axis_of_the_press_with_a_name_that_is_far_too_long"
    told = {describe(f"{begin}{alike}{end}") for begin in "lr" for end in ("_front", "_rear")}
    assert len(told) == 4
