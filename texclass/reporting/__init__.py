"""Results to tables, pictures and files."""

from texclass.reporting.inspection import draw_inspection
from texclass.reporting.listings import dataset_table, feature_table
from texclass.reporting.report import write_report
from texclass.reporting.tables import benchmark_table

__all__ = ["benchmark_table", "dataset_table", "draw_inspection", "feature_table", "write_report"]
