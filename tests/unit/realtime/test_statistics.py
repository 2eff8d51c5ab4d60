import numpy as np
import pytest

from hil_bench.realtime.statistics import DurationHistogram, TickStatistics


def histogram_of(*durations_us):
    histogram = DurationHistogram()
    for duration in durations_us:
        histogram.record(round(duration * 1_000))
    return histogram


def test_percentiles_of_nothing_are_zero():
    summary = DurationHistogram().summary()
    assert (summary.p50_us, summary.p99_us, summary.p999_us, summary.max_us) == (0, 0, 0, 0)


def test_percentile_is_the_upper_edge_of_the_nearest_rank_bin():
    # 1..100 us, 0.5 us above each: nearest rank 50 % is the 50th value, 50.5, in the bin 50..51.
    histogram = histogram_of(*(n + 0.5 for n in range(1, 101)))
    assert histogram.percentile(50) == 51
    assert histogram.percentile(99) == 100
    assert histogram.percentile(0) == 2


def test_percentile_never_exceeds_the_maximum():
    histogram = histogram_of(26.3)
    assert histogram.percentile(50) == pytest.approx(26.3)
    assert histogram.maximum == 26_300


def test_percentiles_agree_with_a_sorted_list():
    durations = np.random.default_rng(7).integers(0, 2_040_000, 5_000)  # [ns]
    histogram = DurationHistogram()
    for duration in durations.tolist():
        histogram.record(duration)
    for percent in (1, 25, 50, 90, 99, 99.9):
        # Nearest rank, a whole number for each of these.
        exact_us = sorted(durations.tolist())[round(durations.size * percent / 100) - 1] / 1_000
        assert exact_us <= histogram.percentile(percent) <= exact_us + 1.0


@pytest.mark.parametrize(
    ("duration_us", "edge_us"),
    [
        (2_047.9, 2_048),  # last fine bin
        (2_048, 3_000),  # first coarse bin: 2 to 3 ms
        (2_046_999, 2_047_000),  # last bounded coarse bin
    ],
)
def test_bins_meet_without_a_gap(duration_us, edge_us):
    histogram = histogram_of(duration_us, 5_000_000)
    assert histogram.percentile(50) == edge_us


def test_beyond_the_last_bin_the_maximum_is_all_that_is_known():
    histogram = histogram_of(3_000_000, 9_000_000)
    assert histogram.percentile(50) == histogram.percentile(100) == 9_000_000


def test_a_negative_duration_counts_as_zero():
    histogram = histogram_of(-5, 10)
    assert (histogram.count, histogram.percentile(50)) == (2, 1)
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
    assert (summary.lateness.p50_us, summary.lateness.max_us) == (2, 3)
    assert (summary.work.p50_us, summary.work.max_us) == (21, 60)
