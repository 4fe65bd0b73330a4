"""A survey to look at in the browser: served on this computer, or as a folder that opens from disk."""

from pomona.browser.view.correct import Corrector
from pomona.browser.view.export import FolderOptions, export_folder
from pomona.browser.view.reading import read_survey
from pomona.browser.view.server import SurveyPages, ViewServer
from pomona.browser.view.truth import truth_data

__all__ = ["Corrector", "FolderOptions", "SurveyPages", "ViewServer", "export_folder", "read_survey", "truth_data"]
