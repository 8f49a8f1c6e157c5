"""The online recogniser: blocks of a stream in; events, answers and verdicts out."""
