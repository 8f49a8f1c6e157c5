"""texclass: classify and render surfaces from recordings of a tool's accelerometer.

>>> import texclass as tx
>>> dataset = tx.open_dataset("simulated")
>>> dataset.labels.nunique()
24

`import texclass` loads no submodules; each name is loaded when it is first used.
"""

import lazy_loader

from texclass._version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
