"""A bench that is suspended for longer than it makes up for, and its controller is not."""

import re
import signal
import struct

import can

NMT_START_ALL = "000#0100"
VALVE_EMCY, VALVE_STATUS, COMMAND, VALVE_ANSWER, POSITION = 0x081, 0x181, 0x201, 0x581, 0x184
RPDO_TIMED_OUT = 0x8250  # EMCY code of CiA 301
ACTIVE = 0x0F  # low byte of the CiA 408 status word
FULL_SCALE = 16384  # 100 % in 0x6301
PERIOD = 0.010  # of the command [s]
SUSPENDED = 150  # periods: 1.5 s, and the bench makes up for 1 s


def test_a_suspended_bench_leaves_periods_out_and_goes_on(start_bench, channel, cansend, watch):
    bench = start_bench()
    cansend("601#2B00140564000000")  # 0x1400.05: RPDO time-out 100 ms
    watch.wait_for(VALVE_ANSWER)
    cansend(NMT_START_ALL)
    with can.Bus(interface="socketcan", channel=channel) as bus:
        half_open = can.Message(
            arbitration_id=COMMAND, data=bytes.fromhex("07000020"), is_extended_id=False
        )
        task = bus.send_periodic(half_open, PERIOD)  # by the kernel
        watch.wait_for(VALVE_STATUS, lambda data: data[0] == ACTIVE)
        bench.process.send_signal(signal.SIGSTOP)
        for _ in range(SUSPENDED):
            watch.wait_for(COMMAND)
        bench.process.send_signal(signal.SIGCONT)
        watch.take_all()
        watch.wait_for(POSITION)
        task.stop()
    watch.wait_for(VALVE_EMCY, lambda data: struct.unpack_from("<H", data)[0] == RPDO_TIMED_OUT)
    watch.wait_for(
        VALVE_STATUS, lambda data: abs(struct.unpack_from("<h", data, 2)[0]) <= FULL_SCALE // 100
    )
    ended = bench.stop()
    assert ended.exit_code == 130, ended
    assert int(re.search(r"(\d+) skipped", ended.stdout)[1]) >= 1000
