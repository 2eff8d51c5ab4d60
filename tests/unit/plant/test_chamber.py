import pytest

from hil_bench.plants.hydraulic_cylinder.model.chamber import chamber_volumes, net_flows

TABLE_I = (1e8, 0.0, 5e-3, 4.7e-3, 1.2e-3, 1.15e-3, 0.2)


@pytest.mark.parametrize(
    ("x", "V_A", "V_B"),
    [  # eqs. (10), (11) by hand
        (0.0, 1.2e-3, 1.15e-3),
        (0.1, 1.7e-3, 0.68e-3),
        (0.2, 2.2e-3, 0.21e-3),
        (0.5, 2.2e-3, 0.21e-3),
        (-0.2, 0.2e-3, 2.09e-3),
        (-9.0, 0.2e-3, 2.09e-3),
    ],
)
def test_volumes(x, V_A, V_B):
    assert chamber_volumes(x, TABLE_I) == pytest.approx((V_A, V_B), rel=1e-12)


def test_net_flows():
    # Brackets of eqs. (8), (9): 3e-4 - 5e-3 * 0.02 - 1e-5 and -2e-4 + 4.7e-3 * 0.02 + 1e-5
    net = net_flows(3e-4, -2e-4, 0.02, 1e-5, TABLE_I)
    assert net == pytest.approx((1.9e-4, -9.6e-5), rel=1e-12)
