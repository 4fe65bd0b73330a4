"""`report.html` and `contact_sheet.jpg`: a survey to look at."""

from pomona.stages.report.contact_sheet import write_contact_sheet
from pomona.stages.report.data import ReportData, StageTime, engines_of, settings_in_words
from pomona.stages.report.options import ContactSheetOptions, ReportOptions
from pomona.stages.report.page import write_report

__all__ = [
    "ContactSheetOptions",
    "ReportData",
    "ReportOptions",
    "StageTime",
    "engines_of",
    "settings_in_words",
    "write_contact_sheet",
    "write_report",
]
