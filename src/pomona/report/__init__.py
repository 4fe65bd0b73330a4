"""`report.html` and `contact_sheet.jpg`: a survey to look at."""

from pomona.report.contact_sheet import ContactSheetOptions, write_contact_sheet
from pomona.report.data import ReportData, StageTime
from pomona.report.page import write_report

__all__ = ["ContactSheetOptions", "ReportData", "StageTime", "write_contact_sheet", "write_report"]
