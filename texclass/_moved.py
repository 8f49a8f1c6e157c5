"""Import paths of texclass 0.1 that are gone: whoever still uses one is told the new one."""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "texclass.experiment.peers": "texclass.peers",
    "texclass.experiment.tradeoff": "texclass.tradeoff",
    "texclass.features.view": "texclass.features.phase_view",
    "texclass.features.views": "texclass.features.conditioning",
    "texclass.filters": "texclass.signals",
    "texclass.recognition.online": "texclass.recognition.live",
    "texclass.recognition.onnx_export": "texclass.recognition.export",
    "texclass.recognition.robot": "texclass.recognition.sources",
    "texclass.reporting.reproductions": "examples/papers of the source distribution",
    "texclass.scene.exchange": "texclass.exchange",
}


class _Moved:
    """Asked by the import system before all others, as folders of an older version may be left behind."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Raise if a module has moved; it is not found otherwise."""
        if name in MOVED:
            raise ModuleNotFoundError(f"{name} is {MOVED[name]} since texclass 0.2", name=name)
        return None


def tell() -> None:
    """Tell the new path from now on wherever an old one is imported."""
    if _Moved not in sys.meta_path:
        sys.meta_path.insert(0, _Moved)
