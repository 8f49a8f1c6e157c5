import numpy as np

from texclass.stability import inputs as battery
from texclass.stability.inputs import (
    FAMILIES,
    LONG,
    ORDERS,
    N,
    inputs,
    lengths,
    rates,
    short_signals,
    with_orders,
)


def test_every_input_has_a_unique_name_and_a_documented_family():
    cases = [*inputs(), *lengths(False), *rates(False)]
    assert len({(case.family, case.name) for case in cases}) == len(cases)
    assert {case.family for case in cases} <= set(FAMILIES)


def test_inputs_match_their_names():
    by_name = {case.name: np.asarray(case.x) for case in inputs()}
    assert {f"pole radius 1 - 1e-{d}" for d in range(3, 13)} <= set(by_name)
    assert np.abs(by_name["gain 1e-160"]).max() < 1e-157
    assert np.isfinite(by_name["gain 1e+150"]).all()
    assert not by_name["every third sample"].flags.c_contiguous
    assert not by_name["read-only"].flags.writeable
    assert by_name["int8 square, -128 to 127"].min() == -128
    assert np.isnan(by_name["gap of 100 NaN"]).sum() == 100
    assert all(x.size == N for x in by_name.values())
    assert all(case.x.size == LONG for case in inputs(LONG))
    spectrum = np.abs(np.fft.rfft(by_name["low-passed by 20"]))
    assert spectrum[N // 40 + 1 :].max() < 1e-10 * spectrum.max()
    assert [case.x.size for case in lengths(False)] == list(range(601))
    assert {case.fs for case in rates(False)} >= {500.0, 50_000.0}
    sizes = {(case.order, case.x.size) for case in short_signals(False)}
    assert {(order, order + 1) for order in ORDERS} | {(400, 399), (400, 200)} <= sizes


def test_broken_samples_lie_within_the_first_200():
    assert all(not np.isfinite(c.x[:200]).all() for c in inputs() if c.family == "broken")


def test_with_orders_returns_each_case_at_each_order():
    cases = with_orders(inputs()[:1], quick=False)
    assert [case.order for case in cases] == list(ORDERS)
    assert len({case.name for case in cases}) == len(ORDERS)


def test_the_battery_is_reproducible():
    first_hash = battery.battery_hash()
    inputs.cache_clear()
    battery.plain.cache_clear()
    battery.noise.cache_clear()
    assert battery.battery_hash() == first_hash
