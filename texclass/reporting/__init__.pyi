from .inspection import draw_inspection as draw_inspection
from .inspection import inspected as inspected
from .listings import datasets_document as datasets_document
from .listings import features_document as features_document
from .result_files import read_document as read_document
from .result_files import stale_results as stale_results
from .result_files import write_page as write_page
