"""A simulated chip under small programs of its own: exceptions, time, sleep, buses and faults.

The expected order of exceptions is that of the Armv7-M Architecture Reference Manual, B1.5; times
follow from the clocks that the programs leave as they are behind reset (16 MHz on an F4).
"""

from collections.abc import Callable

import pytest
from support.chip_programs import CAN_BUILD, WHY_NOT, build_for_chip

from hil_bench.abilities.controllers.seam import TimedFrame
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, ControllerError

pytest.importorskip("unicorn")

from hil_bench.abilities.controllers.elf.calls import compiled_calls, find_calls
from hil_bench.abilities.controllers.elf.cpu import Cpu
from hil_bench.abilities.controllers.elf.job import Job
from hil_bench.abilities.controllers.elf.machine import Machine
from hil_bench.abilities.controllers.elf.peripherals.system import SystemControl

pytestmark = pytest.mark.skipif(not CAN_BUILD, reason=WHY_NOT)

MS = 1_000_000
Make = Callable[..., Machine]


@pytest.fixture
def make(tmp_path):
    def build(source, chip="STM32F407", per_ms=20000, bit_ns=0):
        core = {"F0": "cortex-m0", "F1": "cortex-m3"}.get(chip[5:7], "cortex-m4")
        path = build_for_chip(source, tmp_path, core)
        return Machine(Job(path, chip, per_ms, 8_000_000, (1,), (bit_ns,)))

    return build


def lines(machine, until=MS):
    machine.advance(until, ())
    return machine.take_text().splitlines()


NESTING = """
#define INTERRUPTS [16 + 5] = low, [16 + 6] = high, [16 + 7] = same
static void high(void) { say("high"); }
static void same(void) { say("same"); }
static void low(void) { say("low"); pend(7); pend(6); say("low on"); }
void program(void)
{ allow(5, 0x80); allow(6, 0x40); allow(7, 0x80); pend(5); say("program"); rest(); }
"""


def test_only_a_more_urgent_interrupt_preempts(make):
    assert lines(make(NESTING)) == ["low", "high", "low on", "same", "program"]


MASKS = """
#define INTERRUPTS [16 + 5] = low, [16 + 6] = high
static void high(void) { say("high"); }
static void low(void) { say("low"); }
void program(void)
{
    allow(5, 0x80); allow(6, 0x40);
    __asm volatile("cpsid i"); pend(5); pend(6); say("masked"); __asm volatile("cpsie i");
    for (volatile int i = 0; i < 50; i++) ;
    __asm volatile("msr basepri, %0" :: "r"(0x80)); pend(5); pend(6); say("half masked");
    __asm volatile("msr basepri, %0" :: "r"(0));
    for (volatile int i = 0; i < 50; i++) ;
    say("open"); rest();
}
"""


def test_masks_hold_interrupts_back(make):
    said = ["masked", "high", "low", "high", "half masked", "low", "open"]
    assert lines(make(MASKS)) == said


def test_an_interrupt_wakes_a_masked_sleeper_and_waits(make):
    said = lines(
        make("""
#define SYSTICK tick
static void tick(void) { R32(0xE000E010) = 0; say("tick"); }
void program(void)
{
    R32(0xE000E014) = 1599; R32(0xE000E018) = 0; R32(0xE000E010) = 7;
    __asm volatile("cpsid i\\nwfi"); say("awake"); __asm volatile("cpsie i\\nisb");
    for (volatile int i = 0; i < 50; i++) ;
    rest();
}
""")
    )
    assert said == ["awake", "tick"]


def test_wfe_sleeps_again_once_its_event_is_used_up(make):
    machine = make("""
#define SYSTICK tick
static void tick(void) { }
void program(void)
{
    R32(0xE000E014) = 15999; R32(0xE000E018) = 0; R32(0xE000E010) = 7;
    for (;;) { __asm volatile("wfe"); say("awake"); }
}
""")
    # A tick of 1 ms wakes it, and leaves an event behind that one further WFE takes.
    assert 3 <= len(lines(machine, 3 * MS + MS // 2)) <= 6


SWITCH = """
#define SVC svc
#define PENDSV pendsv
static uint32_t stack[64];
static volatile float kept;
static void pendsv(void) { volatile float mine = 2.5f; mine *= 2.0f; say("pendsv"); }
static void __attribute__((naked)) svc(void)
{
    __asm volatile("push {r4, lr}\\nldr r0, =0xE000ED04\\nmov r1, #0x10000000\\nstr r1, [r0]\\n"
                   "bl said_svc\\npop {r4, pc}");
}
__attribute__((used)) static void said_svc(void) { say("svc"); }
void program(void)
{
    R32(0xE000ED88) |= 0xFu << 20;
    __asm volatile("msr psp, %0\\nmov r0, #2\\nmsr control, r0\\nisb" :: "r"(stack + 64) : "r0");
    register float value __asm("s3") = 1.25f;
    __asm volatile("vmov.f32 s3, %1\\nmov r5, #77\\nsvc #1\\nvmov.f32 %0, s3"
                   : "=t"(value) : "t"(1.25f) : "r5");
    kept = value;
    uint32_t number, control;
    __asm volatile("mov %0, r5\\nmrs %1, control" : "=r"(number), "=r"(control));
    say(kept == 1.25f ? "float kept" : "float lost");
    say((control & 2) ? "on its own stack" : "on another");
    rest();
}
"""


def test_a_call_chains_into_pendsv_and_keeps_floats_and_stack(make):
    assert lines(make(SWITCH)) == ["svc", "pendsv", "float kept", "on its own stack"]


def test_systick_counts_the_clock_behind_reset(make):
    machine = make("""
#define SYSTICK tick
static void tick(void) { say("tick"); }
void program(void) { R32(0xE000E014) = 15999; R32(0xE000E018) = 0; R32(0xE000E010) = 7; rest(); }
""")
    # 16,000 counts of 16 MHz are 1 ms: in 10.5 ms there are ten.
    assert lines(machine, 10 * MS + MS // 2) == ["tick"] * 10


def test_a_timer_tells_of_compare_and_update(make):
    machine = make("""
#define INTERRUPTS [16 + 28] = timer
static void timer(void)
{
    uint32_t flags = R32(0x40000010);
    R32(0x40000010) = ~flags;
    if (flags & 2) say("compare");
    if (flags & 1) say("update");
}
void program(void)
{
    R32(0x40000028) = 15; R32(0x4000002C) = 999; R32(0x40000034) = 300;
    R32(0x40000014) = 1; R32(0x40000010) = 0; R32(0x4000000C) = 3;
    allow(28, 0); R32(0x40000000) = 1; rest();
}
""")
    # 16 MHz / 16 counts microseconds: compare at 0.3 ms of each millisecond, update at its end.
    assert lines(machine, MS // 2) == ["compare"]
    assert lines(machine, 3 * MS) == ["update", "compare", "update", "compare"]


def test_a_timer_is_read_while_it_counts_and_while_it_stands(make):
    machine = make("""
#define SYSTICK tick
#define COUNT 0x40000024
static unsigned turn;
static void tick(void)
{
    uint32_t due = ++turn * 1000 % 2500;
    if (turn == 5) R32(0x40000000) = 0;
    if (turn >= 5) due = 0;
    uint32_t word = R32(COUNT) - due, half = *(volatile uint16_t *)COUNT - due;
    uint8_t byte = *(volatile uint8_t *)COUNT - due;
    say(word < 3 && half < 3 && byte < 3 ? "right" : "wrong");
}
void program(void)
{
    turn = 0;
    R32(0x40000028) = 15; R32(0x4000002C) = 2499; R32(0x40000014) = 1; R32(0x40000010) = 0;
    R32(0xE000E014) = 15999; R32(0xE000E018) = 0;
    R32(0x40000000) = 1; R32(0xE000E010) = 7;
    rest();
}
""")
    # 16 MHz / 16 counts microseconds, 0 to 2499; it is read up to 3 us behind each of seven ms.
    assert lines(machine, 7 * MS + MS // 2) == ["right"] * 7


def test_a_bit_band_reaches_memory_and_registers(make):
    said = lines(
        make("""
static volatile uint32_t word = 0;
void program(void)
{
    word = 0x10;
    R32(0x22000000 + ((uint32_t)&word - 0x20000000) * 32 + 3 * 4) = 1;
    say(word == 0x18 ? "set" : "not set");
    R32(0x42000000 + 0x23800 * 32 + 24 * 4) = 1;                   /* PLLON of RCC_CR */
    say(R32(0x40023800) >> 25 & 1 ? "ready" : "not ready");
    rest();
}
""")
    )
    assert said == ["set", "ready"]


ECHO = """
#define INTERRUPTS [16 + 20] = received
static void received(void)
{
    while (R32(CAN1 + 0x0C) & 3) {
        uint32_t id = R32(CAN1 + 0x1B0), length = R32(CAN1 + 0x1B4), low = R32(CAN1 + 0x1B8);
        R32(CAN1 + 0x0C) = 32;
        R32(CAN1 + 0x184) = length & 15; R32(CAN1 + 0x188) = low + 1; R32(CAN1 + 0x18C) = 0;
        R32(CAN1 + 0x180) = id + (1u << 21) + 1;
    }
}
void program(void)
{
    R32(CAN1) = 1; R32(CAN1 + 0x1C) = 0x00230002;
    R32(CAN1 + 0x200) = 0xE01; R32(CAN1 + 0x20C) = 1; R32(CAN1 + 0x240) = 0x100u << 21;
    R32(CAN1 + 0x244) = 0x700u << 21; R32(CAN1 + 0x21C) = 1; R32(CAN1 + 0x200) = 0xE00;
    R32(CAN1 + 0x14) = 2; allow(20, 0); R32(CAN1) = 0; rest();
}
"""


def test_a_frame_that_a_filter_wants_is_answered(make):
    machine = make(ECHO)
    machine.advance(MS, ())
    wanted = TimedFrame(MS, Frame(0x123, b"\x05\x00"))
    foreign = TimedFrame(MS, Frame(0x223, b"\x05\x00"))
    sent = machine.advance(2 * MS, (foreign, wanted))
    assert [frame for _, frame in sent] == [Frame(0x124, b"\x06\x00")]
    assert MS < sent[0].time <= 2 * MS


def test_a_bus_with_a_bit_rate_takes_time(make):
    machine = make(ECHO, bit_ns=2000)
    machine.advance(MS, ())
    assert machine.advance(MS + 200_000, (TimedFrame(MS, Frame(0x123, b"\x05\x00")),)) == []
    # Two frames of 47 bits and 2 bytes each at 500 kbit/s: 2 * 63 * 2 us.
    (sent,) = machine.advance(2 * MS, ())
    assert MS + 252_000 <= sent.time < MS + 262_000


def test_the_same_life_has_the_same_bytes(make):
    lives = []
    for _ in range(2):
        machine = make(ECHO)
        sent = []
        for tick in range(1, 50):
            frames = [TimedFrame((tick - 1) * MS, Frame(0x100 + tick % 4, bytes([tick])))] * 3
            sent += machine.advance(tick * MS, frames)
        lives.append(sent)
    assert lives[0] == lives[1] != []


def test_power_off_forgets_memory(make):
    machine = make("""
static volatile uint32_t word;
void program(void)
{ say(word == 1 ? "kept" : word == 0xA5A5A5A5 ? "fresh" : "other"); word = 1; rest(); }
""")
    assert lines(machine) == ["fresh"]
    machine.switch_on(5 * MS)
    assert lines(machine, 6 * MS) == ["fresh"]


def test_a_reset_by_the_program_keeps_memory(make):
    machine = make("""
static volatile uint32_t word;
void program(void)
{
    say(word == 7 ? "again" : "first");
    if (word != 7) { word = 7; R32(0xE000ED0C) = 0x05FA0004; for (;;) ; }
    rest();
}
""")
    said = lines(machine)
    assert said[0] == "first"
    assert said[1].endswith("resets itself")
    assert said[2:] == ["again"]


WATCHED = """
void program(void)
{{
    say(R32(0x40023874) >> 29 & 1 ? "bitten" : "fresh");
    R32(0x40023874) = 1u << 24;
    R32(0x40003000) = 0x5555; R32(0x40003004) = 1; R32(0x40003008) = 39; R32(0x40003010) = 30;
    R32(0x40003000) = 0xCCCC;
    for (int fed = 0; fed < 3; fed++) {{
        for (volatile int i = 0; i < {turns}; i++) ;
        R32(0x40003000) = 0xAAAA;
    }}
    for (;;) ;
}}
"""


def test_a_watchdog_that_is_not_fed_resets_the_chip(make):
    machine = make(WATCHED.format(turns=10_000))
    said = lines(machine, 29 * MS)
    # 40 counts of 8 / 32 kHz are 10 ms. It is fed thrice, some 3 ms apart, and then no more.
    first, bite, second = said
    assert (first, second) == ("fresh", "bitten")
    assert bite.endswith("the watchdog resets it: it was not fed for 10 ms")
    time_s = float(bite[1:].partition(" s]")[0])
    assert 0.016 < time_s < 0.022


def test_a_watchdog_with_a_window_is_not_fed_early(make):
    # Open from 9 counts of 0.25 ms on; 1,000 turns of some instructions are less.
    first, bite, *_ = lines(make(WATCHED.format(turns=1000)))
    assert first == "fresh"
    assert bite.endswith("the watchdog resets it: it was fed too early")


def test_a_peripheral_without_a_model_is_named_once(make):
    machine = make(
        "void program(void) { R32(0x40005400) = 5; R32(0x40005404) = R32(0x40005400); rest(); }"
    )
    (said,) = lines(machine)
    assert said.endswith("uses I2C1 at 0x40005400, which is memory here and does nothing")


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("R32(0x90000000) = 1;", "writes to 0x90000000, where nothing is"),
        ("(void)R32(0x90000000);", "reads 0x90000000, where nothing is"),
        ("((void (*)(void))0x90000001)();", "jumps to 0x90000000, where nothing is"),
        ("R32(0x08000000) = 1;", "writes to its flash at 0x08000000 as to memory"),
        ('__asm volatile("udf #0");', "an undefined instruction"),
        ('__asm volatile("bkpt #0");', "a breakpoint"),
        (
            '__asm volatile("mov sp, %0" :: "r"(0x20000010)); pend(5); for (;;) ;',
            "no room on the stack at 0x1FFFFFF0 for interrupt 5",
        ),
    ],
)
def test_a_fault_names_function_and_reason(make, body, what):
    machine = make(f"""
#define INTERRUPTS [16 + 5] = rest
static __attribute__((noinline)) void faulty(void) {{ allow(5, 0); {body} __asm volatile(""); }}
void program(void) {{ faulty(); rest(); }}
""")
    with pytest.raises(ControllerError) as raised:
        machine.advance(MS, ())
    message = str(raised.value)
    assert message.startswith("hard fault in ")
    assert message.endswith(what)
    if "jumps" not in what:
        assert "faulty" in message.partition(", called")[0]
    assert "PC=" in machine.take_text()


def test_exceptions_without_an_end_are_a_fault(make):
    """An SVC in SVCall, which on silicon is a hard fault at the first, ends one of so many."""
    machine = make("""
#define SVC again
static void again(void) { __asm volatile("svc #0"); }
void program(void) { __asm volatile("mov sp, %0" :: "r"(0x20010000)); again(); rest(); }
""")
    with pytest.raises(ControllerError, match=r"no room on the stack at 0x2000.* for SVCall$"):
        machine.advance(MS, ())


def test_a_division_by_zero_gives_zero_as_on_the_core(make):
    said = lines(
        make("""
static volatile int zero = 0;
void program(void) { zero = 0; say(5 / zero == 0 ? "zero" : "other"); rest(); }
""")
    )
    assert said == ["zero"]


DIVIDE = """
static volatile int divisor;
static __attribute__((noinline)) int divide(int by) {{ return ({type})100 / ({type})by; }}
void program(void)
{{
    divisor = 5; say(divide(divisor) == 20 ? "before" : "wrong");
    R32(0xE000ED14) |= 0x10;                                          /* CCR.DIV_0_TRP */
    divisor = 10; say(divide(divisor) == 10 ? "trapped from here" : "wrong");
    divisor = 0; {again} say(divide(divisor) ? "other" : "zero"); rest();
}}
"""


@pytest.mark.parametrize("type_", ["int", "unsigned"])
def test_a_division_by_zero_is_a_trap_where_the_program_asks_for_it(make, type_):
    machine = make(DIVIDE.format(type=type_, again=""))
    with pytest.raises(ControllerError, match=r"^hard fault in divide.*: a division by zero \("):
        machine.advance(MS, ())
    assert machine.take_text().splitlines()[:2] == ["before", "trapped from here"]


def test_a_trap_that_is_switched_off_again_is_none(make):
    source = DIVIDE.format(type="int", again="R32(0xE000ED14) &= ~0x10u;")
    assert lines(make(source)) == ["before", "trapped from here", "zero"]


UNALIGNED = """
static uint8_t bytes[32];
static __attribute__((noinline)) void reach(uint8_t *at) {{ {body} }}
void program(void)
{{ R32(0xE000ED14) |= {trap}; reach(bytes + 8); reach(bytes + 9); rest(); }}
"""
WORD, HALF = "(void)*(volatile uint32_t *)at;", "*(volatile uint16_t *)(at + 2) = 1;"
INDEXED = (
    "(void)*(volatile uint32_t *)(bytes + 4 * (unsigned)(at - bytes) + 4 * (at == bytes + 9));"
)
BYTE = "*(volatile uint8_t *)at = 1;"
DOUBLE = '__asm volatile("ldrd r2, r3, [%0, #4]" :: "r"(at) : "r2", "r3");'
MULTIPLE = '__asm volatile("ldmia %0, {{r2, r3}}" :: "r"(at) : "r2", "r3");'
WIDE = '__asm volatile("stmdb %0, {{r0, r8}}" :: "r"(at));'
FLOAT = '__asm volatile("vldr s0, [%0]" :: "r"(at) : "s0");'
SKIPPED = (
    '__asm volatile("cmp %0, #0\\nit eq\\nldrdeq r2, r3, [%0]" :: "r"(at) : "r2", "r3", "cc");'
)
NO_MEMORY = '__asm volatile("vmov s0, s1, %0, %0" :: "r"(at) : "s0", "s1");'
F4, F1, F0 = "STM32F407", "STM32F103", "STM32F042"


@pytest.mark.parametrize(
    ("chip", "trap", "body", "is_fault"),
    [
        # Armv7-M ARM, A3.2.1: several words, doubles and floats always, any other as CCR has it.
        *((F4, 0, body, True) for body in (DOUBLE, MULTIPLE, WIDE, FLOAT)),
        *((F4, 0, body, False) for body in (WORD, HALF, BYTE, INDEXED, SKIPPED, NO_MEMORY)),
        *((F4, 8, body, True) for body in (WORD, HALF, DOUBLE)),
        *((F4, 8, body, False) for body in (BYTE, INDEXED, SKIPPED)),
        (F1, 0, MULTIPLE, True),
        (F1, 8, WORD, True),
        # Armv6-M ARM, A3.2: each.
        *((F0, 0, body, True) for body in (WORD, HALF, MULTIPLE)),
        (F0, 0, BYTE, False),
    ],
)
def test_an_access_that_is_not_aligned_is_a_fault(make, chip, trap, body, *, is_fault):
    machine = make(UNALIGNED.format(body=body.format(), trap=trap), chip)
    if is_fault:
        with pytest.raises(
            ControllerError, match=r"^hard fault in reach.*: reaches 0x200000\w\w, which"
        ):
            machine.advance(MS, ())
    else:
        machine.advance(MS, ())
        assert machine.wake is not None


@pytest.mark.parametrize("chip", ["STM32F042", "STM32F103"])
def test_other_cores_run(make, chip):
    data = 0x40004428 if chip == "STM32F042" else 0x40004404
    machine = make(
        f"""
#define SYSTICK tick
static void tick(void) {{ R32({data}) = 'x'; R32({data}) = 10; }}
void program(void) {{ R32(0xE000E014) = 7999; R32(0xE000E018) = 0; R32(0xE000E010) = 7; rest(); }}
""",
        chip,
    )
    # 8,000 counts of 8 MHz, the clock of both behind reset.
    assert lines(machine, 3 * MS + MS // 2) == ["x"] * 3


def test_a_program_that_never_waits_costs_its_budget_only(make):
    machine = make("static volatile int n; void program(void) { for (;;) n++; }", per_ms=2000)
    machine.advance(5 * MS, ())
    assert machine.wake is None


def test_what_a_program_does_takes_its_instructions(make):
    machine = make(
        """
#define INTERRUPTS [16 + 5] = rest
void program(void)
{
    uint32_t begin, end, count = 1000;
    allow(5, 0);
    __asm volatile("cpsid i");
    begin = R32(0xE0001004);
    __asm volatile("1: str %1, [%2]\\nnop\\nsubs %0, #1\\nbne 1b"
                   : "+r"(count) : "r"(1u << 5), "r"(0xE000E200u) : "cc");
    end = R32(0xE0001004);
    say((end - begin) / 10 == 320 ? "in time" : "not in time");
    for (;;) ;
}
""",
        per_ms=20_000,
    )
    # 1000 turns of 4 instructions at 20,000 a millisecond are 0.2 ms: 3,200 cycles of 16 MHz.
    assert lines(machine) == ["in time"]


def test_a_sleeper_says_when_it_wakes(make):
    machine = make("""
#define SYSTICK rest
void program(void) { R32(0xE000E014) = 159999; R32(0xE000E018) = 0; R32(0xE000E010) = 7; rest(); }
""")
    machine.advance(MS, ())
    assert machine.wake is not None
    assert 10 * MS <= machine.wake < 10 * MS + 10_000


def test_without_a_compiler_the_calls_are_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match=r'^kind "elf": there is no C compiler \(cc\); install'):
        compiled_calls()


def test_the_groups_of_priorities_and_a_reset_need_the_key_of_aircr():
    cpu = Cpu("Cortex-M4F", find_calls().Exceptions(4, 8), 1000, {})
    system = SystemControl(cpu, 0, lambda: 0)
    system.store(0xD0C, 0x1234_0304)
    assert (cpu.exceptions.group_bits, cpu.wants_reset) == (1, False)
    system.store(0xD0C, 0x05FA_0500)
    assert (cpu.exceptions.group_bits, system.load(0xD0C)) == (6, 0xFA05_0500)
    system.store(0xD0C, 0x05FA_0004)  # SYSRESETREQ
    assert cpu.wants_reset
