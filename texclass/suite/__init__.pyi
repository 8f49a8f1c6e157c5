from .cells import SuiteSettings as SuiteSettings
from .methods import DEFAULT_METHODS as DEFAULT_METHODS
from .methods import Method as Method
from .methods import find_method as find_method
from .runner import available_datasets as available_datasets
from .runner import run_suite as run_suite
