import multiprocessing
import pickle

import numpy as np
import pytest

from hil_bench.outside.realtime.statistics import DurationHistogram, TickStatistics


def histogram_of(*durations_us):
    histogram = DurationHistogram()
    for duration in durations_us:
        histogram.record(round(duration * 1_000))
    return histogram


def test_percentiles_of_nothing_are_zero():
    summary = DurationHistogram().summary()
    assert (summary.p50_us, summary.p99_us, summary.p999_us, summary.max_us) == (0, 0, 0, 0)


def test_percentile_is_the_upper_edge_of_the_nearest_rank_bin():
    # 1 to 100 us: nearest rank 50 % is the 50th value. 50,000 has 16 bits, so bins are 2**8 ns wide
    # there, and that of 50,000 = 195 * 256 + 80 ends with 196 * 256 - 1 = 50,175 ns.
    histogram = histogram_of(*range(1, 101))
    assert histogram.percentile(50) == 50.175
    assert histogram.percentile(100) == 100
    # 1,000 has 10 bits, so bins are 4 ns wide there: 1,000 to 1,003.
    assert histogram.percentile(0) == 1.003


def test_percentile_never_exceeds_the_maximum():
    histogram = histogram_of(26.3)
    assert histogram.percentile(50) == 26.3
    assert histogram.maximum == 26_300


def test_percentiles_agree_with_a_sorted_list():
    durations = (10 ** np.random.default_rng(7).uniform(0, 11, 5_000)).astype(int)  # [ns]
    histogram = DurationHistogram()
    for duration in durations.tolist():
        histogram.record(duration)
    for percent in (1, 25, 50, 90, 99, 99.9):
        # Nearest rank, a whole number for each of these.
        exact_us = sorted(durations.tolist())[round(durations.size * percent / 100) - 1] / 1_000
        assert exact_us <= histogram.percentile(percent) <= exact_us * (1 + 1 / 128)


@pytest.mark.parametrize(
    ("duration", "edge"),
    [
        (0, 0),
        (255, 255),  # the last bin of 1 ns
        (256, 257),  # the first of 2 ns
        (511, 511),  # the last of 2 ns
        (512, 515),  # the first of 4 ns
        (2**40, 2**40 + 2**33 - 1),  # 41 bits: bins of 2**33 ns
    ],
)
def test_bins_meet_without_a_gap(duration, edge):
    histogram = DurationHistogram()
    for value in (duration, 2**50):
        histogram.record(value)
    assert histogram.percentile(50) == edge / 1_000


def test_beyond_the_last_bin_the_maximum_is_all_that_is_known():
    histogram = DurationHistogram()
    for duration in (2**41, 2**60):
        histogram.record(duration)
    assert histogram.percentile(50) == histogram.percentile(100) == 2**60 / 1_000


def test_bins_are_those_with_values_in_them():
    histogram = DurationHistogram()
    for duration in (3, 3, 256, 2**50):
        histogram.record(duration)
    assert list(histogram.bins()) == [(0.003, 2), (0.257, 1), (2**50 / 1_000, 1)]


def test_a_negative_duration_counts_as_zero():
    histogram = histogram_of(-5, 10)
    assert (histogram.count, histogram.percentile(50)) == (2, 0)
    assert histogram.maximum == 10_000


@pytest.mark.parametrize("percent", [-0.1, 100.1])
def test_a_percentile_outside_of_0_to_100_is_refused(percent):
    with pytest.raises(ValueError, match="0 to 100 is right"):
        DurationHistogram().percentile(percent)


def test_the_summary_gathers_both_histograms_and_the_counters():
    statistics = TickStatistics()
    for lateness, work in ((1_000, 20_000), (3_000, 60_000)):
        statistics.lateness.record(lateness)
        statistics.work.record(work)
    statistics.overruns, statistics.skipped = 3, 4
    summary = statistics.summary()
    assert (summary.ticks, summary.overruns, summary.skipped) == (2, 3, 4)
    assert (summary.lateness.p50_us, summary.lateness.max_us) == (1.003, 3)  # bins of 4 ns
    assert (summary.work.p50_us, summary.work.max_us) == (20.095, 60)  # bins of 128 ns


def send_ticks(statistics, connection):
    connection.send(statistics.summary())


def test_another_process_reads_what_is_shared():
    statistics = TickStatistics(is_shared=True)
    statistics.lateness.record(70_000)
    statistics.work.record(20_000)
    statistics.overruns = 3
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=send_ticks, args=(statistics, sender))
    process.start()
    assert receiver.poll(50)
    assert receiver.recv() == statistics.summary()
    process.join()


def test_what_is_not_shared_stays_where_it_is():
    with pytest.raises(TypeError, match="is_shared=True"):
        pickle.dumps(TickStatistics())
