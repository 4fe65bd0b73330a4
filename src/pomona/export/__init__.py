"""Results in the files of other programs: a table of formats, each written from values; `pomona export`."""

from pomona.export.formats import EXPORT_FORMATS, Content, ExportFormat, export_format, write_export
from pomona.export.source import ExportSource, Part

__all__ = ["EXPORT_FORMATS", "Content", "ExportFormat", "ExportSource", "Part", "export_format", "write_export"]
