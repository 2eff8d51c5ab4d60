"""SDO between two ticks: with a tick a second, as many answers as one wants in between."""

import can

REQUEST, ANSWER = 0x601, 0x581  # of the valve
READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")
REQUESTS = 20


def test_sdo_requests_are_answered_between_two_ticks(start_bench, channel, watch, tmp_path):
    config = tmp_path / "slow.toml"
    config.write_text("[bench]\ntick_us = 1000000\n")
    start_bench(config)
    watch.listen_to(ANSWER)
    stamps = []
    with can.Bus(interface="socketcan", channel=channel) as bus:
        for _ in range(REQUESTS):
            bus.send(
                can.Message(arbitration_id=REQUEST, data=READ_DEVICE_TYPE, is_extended_id=False)
            )
            stamps.append(watch.wait_for(ANSWER).timestamp)
    # Each waits for the answer before it: by ticks alone that would take as many seconds.
    assert stamps[-1] - stamps[0] < REQUESTS / 2
