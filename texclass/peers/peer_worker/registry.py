"""The peers: what each computes, what it needs, and the classifiers it is combined with."""

from collections.abc import Callable
from dataclasses import dataclass

from . import cepstra, statistics
from .extractor import Extractor, PerRecording
from .intervals import QuantFeatures
from .rockets import MiniRocketFeatures, MultiRocketHydraFeatures

DISCRIMINANTS = ("lda", "shrinkage_lda", "random_forest")


@dataclass(frozen=True)
class Peer:
    """A tool that users might take instead.

    Attributes
    ----------
    name, title
        On the command line and in the report.
    packages
        Distributions it needs, the most telling first.
    make
        (fs in Hz, seed) -> unfitted extractor.
    classifiers
        Names in `CLASSIFIERS`.
    reference
        Which settings.
    """

    name: str
    title: str
    packages: tuple[str, ...]
    make: Callable[[float, int], Extractor]
    classifiers: tuple[str, ...]
    reference: str


PEERS = {
    peer.name: peer
    for peer in (
        Peer(
            "mfcc",
            "librosa MFCC, mean",
            ("librosa",),
            lambda fs, seed: PerRecording(cepstra.mean, fs),
            (*DISCRIMINANTS, "naive_bayes"),
            "13 coefficients of 26 mel bands, 25 ms frames (50 samples or more), 15 ms hop, mean of frames; "
            "bands chosen with biotac20's test parts in view",
        ),
        Peer(
            "mfcc_deviation",
            "librosa MFCC, mean + deviation",
            ("librosa",),
            lambda fs, seed: PerRecording(cepstra.mean_and_deviation, fs),
            DISCRIMINANTS,
            "the same, with the standard deviation over frames",
        ),
        Peer(
            "tsfel",
            "TSFEL, all",
            ("tsfel",),
            lambda fs, seed: PerRecording(statistics.tsfel_all, fs),
            DISCRIMINANTS,
            "every feature of the default configuration on the whole signal",
        ),
        Peer(
            "tsfresh",
            "tsfresh, minimal",
            ("tsfresh",),
            lambda fs, seed: PerRecording(statistics.tsfresh_minimal, fs),
            DISCRIMINANTS,
            "MinimalFCParameters",
        ),
        Peer(
            "catch22",
            "catch22",
            ("pycatch22",),
            lambda fs, seed: PerRecording(statistics.catch22, fs),
            DISCRIMINANTS,
            "pycatch22, 22 features of the standardised signal",
        ),
        Peer(
            "quant",
            "QUANT",
            ("aeon", "torch"),
            lambda fs, seed: QuantFeatures(),
            ("extra_trees",),
            "aeon QUANTTransformer and extra trees, their defaults",
        ),
        Peer(
            "minirocket",
            "MiniRocket",
            ("aeon",),
            lambda fs, seed: MiniRocketFeatures(seed),
            ("ridge",),
            "aeon MiniRocket, 10,000 kernels, and ridge",
        ),
        Peer(
            "multirocket_hydra",
            "MultiRocket-Hydra",
            ("aeon", "torch"),
            lambda fs, seed: MultiRocketHydraFeatures(seed),
            ("ridge",),
            "aeon MultiRocket and HydraTransformer joined, their defaults, and ridge",
        ),
    )
}
"""Name -> peer; those that take longest last."""
