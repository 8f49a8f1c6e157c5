"""The online recogniser: blocks of a stream in; events, answers and verdicts out."""

from texclass.recognition.online.contact import ContactRules, Event
from texclass.recognition.online.evidence import Evidence, Majority, Sequential, Verdict
from texclass.recognition.online.recogniser import OnlineRecogniser
from texclass.recognition.online.session import Notice, Session
from texclass.recognition.online.settings import OnlineSettings, Update, WindowAnswer

__all__ = [
    "ContactRules",
    "Event",
    "Evidence",
    "Majority",
    "Notice",
    "OnlineRecogniser",
    "OnlineSettings",
    "Sequential",
    "Session",
    "Update",
    "Verdict",
    "WindowAnswer",
]
