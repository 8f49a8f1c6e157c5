"""Speed of autoregressive fits and lattices compared with librosa and scipy, and results on hard signals.

`python benchmarks/autoregressive_speed.py [--rounds N]` writes reports/studies/autoregressive. One
thread; CPU time of that thread; all take turns within each round, medians over rounds are compared.
"""

import warnings
from collections.abc import Callable

import librosa
import numpy as np
import pandas as pd
from scipy import fft, linalg, signal
from study import command_line, in_turns, table, write

from texclass.recording import Samples
from texclass.reporting import Heading, Table
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis, fit
from texclass.vibration.autoregressive import from_direct_form

FS, N, ORDER = 10_000.0, 250_000, 400
WANTED = {18: 5000.0, 400: 300.0}
Fit = Callable[[Samples, int], Autoregression | Samples]


def solve_toeplitz(x: Samples, order: int) -> Samples:
    """Autocorrelation method as scipy offers it, with the autocorrelation by FFT."""
    size = fft.next_fast_len(2 * x.size, real=True)
    r = fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[: order + 1]
    return np.concatenate([[1.0], linalg.solve_toeplitz(r[:-1], -r[1:])])


FITS: dict[str, Fit] = {
    "burg": lambda x, p: fit(x, p, method="burg"),
    "librosa.lpc": lambda x, p: librosa.lpc(x, order=p),
    "autocorrelation": lambda x, p: fit(x, p, method="autocorrelation"),
    "solve_toeplitz": solve_toeplitz,
}


def fits(n_rounds: int) -> dict[str, float]:
    """Milliseconds per fit of one recording."""
    x = signal.lfilter([1.0], [1.0, -1.6, 0.8], np.random.default_rng(0).standard_normal(N))
    hard = np.hanning(N) * oversampled(N)
    calls = {name: lambda each=each: each(x, ORDER) for name, each in FITS.items()}
    calls["autocorrelation, windowed and oversampled"] = lambda: FITS["autocorrelation"](hard, ORDER)
    return (1e3 * in_turns(calls, n_rounds).median()).to_dict()


def lattices(order: int, dtype: type) -> dict[str, Callable[[], object]]:
    """Ten seconds of sound each way."""
    rng = np.random.default_rng(order)
    model = Autoregression(rng.uniform(-0.9, 0.9, order) * np.exp(-np.arange(order) / 5), np.asarray(1.0))
    k = np.linspace(model.reflection, -model.reflection, 1000)
    level = np.linspace(1, 2, 1000)
    e, a = rng.standard_normal(100_000).astype(dtype), model.direct_form().astype(dtype)
    kinds = (LatticeSynthesis, LatticeInverse, LatticeSynthesis)
    forth, back, gliding = (kind(model, dtype=dtype) for kind in kinds)

    def glide() -> None:
        for start in range(0, e.size, 1000):
            gliding.process_varying(e[start : start + 1000], k, level)

    return {
        "synthesis": lambda: forth.process(e),
        "synthesis, calls of 10 ms": lambda: [forth.process(e[i : i + 100]) for i in range(0, e.size, 100)],
        "synthesis, always gliding": glide,
        "inverse": lambda: back.process(e),
        "scipy.signal.lfilter (direct form)": lambda: signal.lfilter(np.ones(1, dtype), a, e),
    }


def oversampled(n: int) -> Samples:
    """Noise below 1/20 of the Nyquist frequency."""
    noise = np.random.default_rng(1).standard_normal(n)
    return np.asarray(signal.sosfilt(signal.butter(8, 1 / 20, output="sos"), noise))


def hard_signals(n: int = 20_000) -> dict[str, Samples]:
    """Where fits break."""
    noise, sine = np.random.default_rng(2).standard_normal(n), np.sin(0.3 * np.arange(n))
    return {
        "zeros": np.zeros(n),
        "constant": np.ones(n),
        "pure sine": sine,
        "sine + 1e-8 noise": sine + 1e-8 * noise,
        "oversampled 20 times": oversampled(n),
        "oversampled, Hann window": np.hanning(n) * oversampled(n),
        "offset 1e6 + 1e-3 noise": 1e6 + 1e-3 * noise,
        "noise, gain 1e-160": 1e-160 * noise,
        "noise, gain 1e150": 1e150 * noise,
    }


def verdict(fitted: Fit, x: Samples, order: int = 32) -> str:
    """Return whether a fit is stable, and the residual relative to the RMS of the signal, as text."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = fitted(x, order)
        if not isinstance(model, Autoregression):
            if not np.all(np.isfinite(model)):
                return "NaN"
            model = from_direct_form(model, np.asarray(1.0))
    except ValueError as error:
        return "not stable" if "reflection" in str(error) else type(error).__name__
    except Exception as error:  # a report of what others do, whatever they do
        return type(error).__name__
    residual, peak = 0.0, np.abs(x).max()
    if peak > 0:  # the RMS of the forward residual over that of the signal, without the first p samples
        unit = x / peak
        error = LatticeInverse(Autoregression(model.reflection, np.asarray(0.0)), level=1.0).process(unit)
        gain = np.exp((np.log1p(model.reflection) + np.log1p(-model.reflection)).sum() / 2)
        residual = gain * np.sqrt(np.mean(error[order:] ** 2) / np.mean(unit**2))
    return f"stable, {residual:.1e}"


def main() -> None:
    args = command_line(__doc__, rounds=9)
    real_time = {
        f"{order}, {np.dtype(dtype)}": 100_000 / FS / in_turns(lattices(order, dtype), args.rounds).median()
        for order in WANTED
        for dtype in (np.float64, np.float32)
    }
    result = {
        "fit_ms": (ms := fits(args.rounds)),
        "real_time": {key: times.to_dict() for key, times in real_time.items()},
        "hard": {
            name: {who: verdict(each, x) for who, each in FITS.items()} for name, x in hard_signals().items()
        },
        "n_rounds": args.rounds,
        "input": {"fs": FS, "n": N, "order": ORDER},
    }
    factors = pd.DataFrame(real_time).T.map("{:.0f}".format)
    factors.insert(0, "wanted", [f"{WANTED[int(key.split(',')[0])]:.0f}" for key in factors.index])
    hard = pd.DataFrame(result["hard"]).T
    blocks = [
        f"Order {ORDER}, one recording of {N} samples, one thread.",
        table(({"fit": k, "ms": v} for k, v in ms.items()), "fit = {fit} | ms = {ms:.1f}"),
        f"Burg takes {ms['burg'] / ms['librosa.lpc']:.2f} of the time of `librosa.lpc`, autocorrelation "
        f"{ms['autocorrelation'] / ms['solve_toeplitz']:.2f} of that of `solve_toeplitz` + FFT (limit: 1).",
        Heading("Times real time at 10 kHz"),
        Table(factors.rename_axis("order, arithmetic").reset_index()),
        Heading("Hard signals, order 32"),
        "What is left of the signal (RMS) by the model returned.",
        Table(hard.rename_axis("signal").reset_index(), n_words=5),
    ]
    write(args.out, "autoregressive", result, "Autoregressive fits and lattices", blocks)


if __name__ == "__main__":
    main()
