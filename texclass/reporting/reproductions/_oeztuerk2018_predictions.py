"""What the report on `oeztuerk2018` says of speeds that were predicted."""

from collections.abc import Sequence

from texclass.reporting.words import line_of
from texclass.textures.oeztuerk2018.prediction import Prediction, mean_scores
from texclass.textures.oeztuerk2018.study import N_SURFACES, SPEEDS_MM_S, Study

ABSENT = "Skipped: the recordings are not on this machine (`TEXCLASS_DATA`)."


def table(head: Sequence[str], *rows: Sequence[str]) -> str:
    """Return a table in Markdown."""
    return "\n".join(line_of(tuple(row)) for row in [head, ["---"] * len(head), *rows])


def predictions(result: Study, seconds: Sequence[float]) -> str:
    """Return what the report says of speeds between those that were fitted."""
    speeds = ", ".join(f"{v:g}" for v in SPEEDS_MM_S)
    simulated = (
        f"### {N_SURFACES} simulated surfaces at {speeds} mm/s\n\n{_scores(result.simulated)}\n\n"
        + _verdict(result.simulated, "simulated surfaces")
    )
    if not result.real:
        return f"{simulated}\n\n### fabric_speeds\n\n{ABSENT}"
    lasting = ", ".join(f"{s:.1f}" for s in seconds)
    ratio = " : ".join(f"{seconds[0] / s:.1f}" for s in seconds)
    parts = [
        f"{name}: {_verdict([p for p in result.real if p.speed == v], 'fabrics')}"
        for name, v in (("v2", 2.0), ("v3", 3.0))
    ]
    return f"""\
{simulated}

### fabric_speeds: four fabrics, real

{_scores(result.real)}

{parts[0]}

{parts[1]}

The speeds are not known; 1, 2, 3, 4 stand for them. The recordings last {lasting} s in the median. If each is
one stroke over a swatch of one size, the speeds are to each other as {ratio}, and what stands at 2 and 3
here lies elsewhere between the ends."""


def _scores(predictions: Sequence[Prediction]) -> str:
    rows = [
        [way, f"{s.log_spectral_db:.2f}", f"{s.band_db:.2f}", f"{s.gfc:.3f}", f"{s.level_db:.2f}"]
        for way, s in mean_scores(predictions).items()
    ]
    head = ["way", "log spectral (dB)", "nine bands (dB)", "goodness of fit", "level off by (dB)"]
    return table(head, *rows)


def _verdict(predictions: Sequence[Prediction], what: str) -> str:
    mean = mean_scores(predictions)
    by_gain, by_level, nearest = (mean[way] for way in ("LPC, log gain", "LPC, log level", "nearest speed"))
    wins = sum(
        p.scores["LPC, log gain"].log_spectral_db < p.scores["nearest speed"].log_spectral_db
        for p in predictions
    )
    return f"""\
LPC between speeds (log gain, as the thesis) is nearer to the recording than the recording of the nearest
speed in {wins} of {len(predictions)} cases ({what}; log spectral distance {by_gain.log_spectral_db:.2f}
against {nearest.log_spectral_db:.2f} dB). The log level mixed instead of the log gain brings the error of the
level from {by_gain.level_db:.2f} to {by_level.level_db:.2f} dB."""
