"""Detection of drift over the contacts of a stream, and slow adaptation to it."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from texclass.recognition.adaptation import LIMITS
from texclass.recognition.answers import Answer, average_answers
from texclass.recognition.drift import adapt_to_answers, detect_drift
from texclass.recognition.live.online_recogniser import WindowAnswer
from texclass.recognition.model import Model
from texclass.recognition.model_document import describe_shift
from texclass.reporting.wording import counted


@dataclass(frozen=True)
class DriftMonitorSettings:
    """Settings of the test for drift in a stream.

    Attributes
    ----------
    n_contacts : int
        Number of the last contacts that are tested, and to which the model is adapted.
    n_between : int
        Number of new contacts between two tests.
    n_windows : int
        Maximum number of windows of a contact that are used. Windows of one contact are correlated, so more
        windows mainly add computing time.
    """

    n_contacts: int = 60
    n_between: int = 10
    n_windows: int = 3


class DriftMonitor:
    """Test for drift over the last contacts of a stream, and adapt the model to them.

    Every contact counts once, whatever its number of windows. If a tool is always in contact, a contact ends
    when the predicted surface changes. An adaptation always starts from the original model and uses the last
    contacts without labels, so the model follows slowly. It requires contacts with several surfaces;
    otherwise the model stays as it is.

    Parameters
    ----------
    model : Model
        Trained model.
    adapts : bool
        Whether to adapt the model (default False: only report drift).
    is_always_in_contact : bool
        Whether the tool is always in contact (default False).
    settings : DriftMonitorSettings
        Settings of the test.

    Attributes
    ----------
    model : Model
        Model for the next contact: the original one, or its last adaptation.

    Examples
    --------
    >>> monitor = DriftMonitor(load_model("surfaces.skops"), adapts=True)  # doctest: +SKIP
    >>> monitor.add(window_answer)  # doctest: +SKIP
    >>> monitor.end_contact()  # doctest: +SKIP
    ''
    """

    def __init__(
        self,
        model: Model,
        *,
        adapts: bool = False,
        is_always_in_contact: bool = False,
        settings: DriftMonitorSettings | None = None,
    ) -> None:
        self.model, self.adapts = model, adapts
        self._original, self._is_always_in_contact = model, is_always_in_contact
        self._settings = settings or DriftMonitorSettings()
        self._contacts = deque[Answer](maxlen=self._settings.n_contacts)
        self._windows, self._surface = list[Answer](), ""
        self._n_contacts, self._n_new, self._has_drift = 0, 0, False

    def add(self, update: WindowAnswer) -> str:
        """Add the answer for a window; return a message if it ends a contact that has to be reported."""
        surface, message = update.verdict.surface, ""
        if self._is_always_in_contact and self._windows and surface != self._surface:
            message = self.end_contact()
        self._windows.append(update.answer)
        self._surface = surface
        return message

    def end_contact(self, *, is_last: bool = False) -> str:
        """End the current contact and test for drift if there are enough new ones.

        Parameters
        ----------
        is_last : bool
            Whether the stream ends, so that all new contacts are tested (default False).

        Returns
        -------
        str
            Message about drift or an adaptation, else empty.
        """
        if n := len(self._windows):
            chosen = np.linspace(0, n - 1, min(n, self._settings.n_windows)).round().astype(int)
            self._n_contacts += 1
            windows = [self._windows[i] for i in chosen.tolist()]
            self._contacts.append(average_answers(windows, f"contact {self._n_contacts}"))
            self._windows.clear()
            self._n_new += 1
        n_needed = 1 if is_last else self._settings.n_between
        if self._n_new < n_needed or len(self._contacts) < LIMITS.min_unlabelled:
            return ""
        self._n_new = 0
        return self._adapt() if self.adapts else self._test()

    def _test(self) -> str:
        """Return a message if drift is detected that was not detected before."""
        drift = detect_drift(self._original, list(self._contacts))
        had_drift, self._has_drift = self._has_drift, drift.is_detected
        return f"{drift.message}. Adapt the model with --adapt" if drift.is_detected and not had_drift else ""

    def _adapt(self) -> str:
        """Adapt the original model to the last contacts, and return a message if columns are shifted."""
        try:
            adapted = adapt_to_answers(self._original, list(self._contacts))
        except ValueError:  # too few surfaces among the last contacts: the model stays as it is
            return ""
        self.model = adapted
        entry = adapted.manifest.adapted
        if not entry["n_shifted"]:
            return ""
        n_contacts = counted(len(self._contacts), "contact")
        return f"drift: adapted to the last {n_contacts}: {describe_shift(entry)}"
