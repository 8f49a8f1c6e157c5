"""Inner loops of the normalised lattice, in which every sample meets the same operations in one order.

Stage m turns the forward residual f_m of a sample and the backward residual b_{m-1} of the sample before::

    f_{m-1} = c f_m - k b_{m-1},    b_m = k f_m + c b_{m-1},    c = sqrt(1 - k^2)

Each line is one product and one fused multiply-add, spelt out so that no compiler chooses for itself: pieces
of a signal then equal the whole bit for bit.
"""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import intrinsic
from numpy.typing import NDArray

Real = NDArray[np.floating]

FOURS_ORDER = 6
"""Least order with four samples in flight."""
WAVE_ORDER = 192
"""From this order on the wave front is faster than samples in fours."""


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Type and generate a b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return a(a, b, c), generate


fma: Any = intrinsic(_fma)


@njit(inline="always", error_model="numpy")
def turn(f, b, k, c):  # type: ignore[no-untyped-def]
    """Return f_{m-1} and b_m."""
    return fma(c, f, -(k * b)), fma(k, f, c * b)


@njit(cache=True, error_model="numpy")
def synthesize(x: Real, k: Real, c: Real, b: Real) -> None:
    """Turn the excitation `x` into f_0 in place, one sample after the other; state b_0 ... b_{p-1} in `b`."""
    p = k.size
    for t in range(x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, up = turn(f, b[m], k[m], c[m])
            b[m + 1] = up
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def synthesize_fours(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `synthesize` does with four samples in flight, each two stages behind the one before.

    For p >= `FOURS_ORDER` and a multiple of four samples. b1, b2, b3 go from one sample to the next.
    """
    p = k.size
    q = p - 1
    for t in range(0, x.size, 4):
        f0, f1, f2, f3 = x[t], x[t + 1], x[t + 2], x[t + 3]
        f0, b1 = turn(f0, b[q], k[q], c[q])
        f0, b1 = turn(f0, b[q - 1], k[q - 1], c[q - 1])
        f1, b2 = turn(f1, b1, k[q], c[q])
        f0, b1 = turn(f0, b[q - 2], k[q - 2], c[q - 2])
        f1, b2 = turn(f1, b1, k[q - 1], c[q - 1])
        f0, b1 = turn(f0, b[q - 3], k[q - 3], c[q - 3])
        f2, b3 = turn(f2, b2, k[q], c[q])
        f1, b2 = turn(f1, b1, k[q - 2], c[q - 2])
        f0, b1 = turn(f0, b[q - 4], k[q - 4], c[q - 4])
        f2, b3 = turn(f2, b2, k[q - 1], c[q - 1])
        f1, b2 = turn(f1, b1, k[q - 3], c[q - 3])
        f0, b1 = turn(f0, b[q - 5], k[q - 5], c[q - 5])
        for m in range(p - 7, -1, -1):
            f3, up = turn(f3, b3, k[m + 6], c[m + 6])
            f2, b3 = turn(f2, b2, k[m + 4], c[m + 4])
            f1, b2 = turn(f1, b1, k[m + 2], c[m + 2])
            f0, b1 = turn(f0, b[m], k[m], c[m])
            b[m + 7] = up
        f3, b[6] = turn(f3, b3, k[5], c[5])
        f2, b3 = turn(f2, b2, k[3], c[3])
        f1, b2 = turn(f1, b1, k[1], c[1])
        f3, b[5] = turn(f3, b3, k[4], c[4])
        f2, b3 = turn(f2, b2, k[2], c[2])
        f1, b2 = turn(f1, f0, k[0], c[0])
        f3, b[4] = turn(f3, b3, k[3], c[3])
        f2, b3 = turn(f2, b2, k[1], c[1])
        f3, b[3] = turn(f3, b3, k[2], c[2])
        f2, b3 = turn(f2, f1, k[0], c[0])
        f3, b[2] = turn(f3, b3, k[1], c[1])
        f3, b[1] = turn(f3, f2, k[0], c[0])
        b[0] = f3
        x[t], x[t + 1], x[t + 2], x[t + 3] = f0, f1, f2, f3


@njit(cache=True, error_model="numpy")
def _front(f: Real, b: Real, out: Real, k: Real, c: Real) -> None:
    """Take each sample of the front one stage down."""
    for j in range(f.size):
        f[j], out[j] = turn(f[j], b[j], k[j], c[j])


@njit(cache=True, error_model="numpy")
def synthesize_front(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `synthesize` does along a wave front: sample j is two stages behind sample j - 1.

    At step s sample j is at stage m = p - s + 2 j, so that all stages of one step are independent of each
    other; k and c of every second stage are laid side by side.
    """
    p, n = k.size, x.size
    k_odd, k_even = k[0::2].copy(), k[1::2].copy()  # stages 1, 3, ... and 2, 4, ...
    c_odd, c_even = c[0::2].copy(), c[1::2].copy()
    now, after = np.zeros(n + 1, x.dtype), np.zeros(n + 1, x.dtype)
    last = np.zeros(p + 1, x.dtype)  # b of the last sample
    for s in range(p + 2 * n - 1):
        if s < p:
            now[0] = b[p - s - 1]
        low = max((s - p + 2) // 2, 0)  # m = p - s + 2 j >= 1
        high = min(s // 2 + 1, n)  # m <= p
        if s >= p and (s - p) % 2 == 0 and (s - p) // 2 < n:
            after[(s - p) // 2 + 1] = x[(s - p) // 2]  # b_0 is f_0
        if high > low:
            first = (p - s + 2 * low - 1) // 2
            size = high - low
            odd = (p - s) % 2 != 0
            kk = k_odd if odd else k_even
            cc = c_odd if odd else c_even
            _front(
                x[low:high],
                now[low:high],
                after[low + 1 : high + 1],
                kk[first : first + size],
                cc[first : first + size],
            )
            if high == n:
                last[p - s + 2 * (n - 1)] = after[n]
        now, after = after, now
    b[0] = x[n - 1]
    b[1:p] = last[1:p]


@njit(cache=True, error_model="numpy")
def synthesize_rows(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `synthesize` does with parameters (n, p) of each sample's own."""
    p = k.shape[1]
    for t in range(x.size):
        f = x[t]
        for m in range(p - 1, -1, -1):
            f, b[m + 1] = turn(f, b[m], k[t, m], c[t, m])
        b[0] = f
        x[t] = f


@njit(cache=True, error_model="numpy")
def whiten(x: Real, k: Real, c: Real, b: Real) -> None:
    """Turn f_0 in `x` into the excitation in place: what `synthesize` did, undone stage by stage."""
    now, after = np.zeros(x.size + 1, x.dtype), np.zeros(x.size + 1, x.dtype)
    now[1:] = x
    for m in range(k.size):
        now[0] = b[m]  # b_m of the sample before
        b[m] = now[x.size]
        for t in range(x.size):  # f_m = (f_{m-1} + k b_{m-1}) / c and b_m = k f_m + c b_{m-1}
            x[t] = fma(k[m], now[t], x[t]) / c[m]
            after[t + 1] = fma(k[m], x[t], c[m] * now[t])
        now, after = after, now


@njit(cache=True, error_model="numpy")
def whiten_rows(x: Real, k: Real, c: Real, b: Real) -> None:
    """Do what `whiten` does with parameters (n, p) of each sample's own."""
    for t in range(x.size):
        f = x[t]
        up = f
        for m in range(k.shape[1]):
            below = b[m]
            b[m] = up
            f = fma(k[t, m], below, f) / c[t, m]
            up = fma(k[t, m], f, c[t, m] * below)
        x[t] = f
