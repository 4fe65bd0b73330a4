"""A survey to look at in the browser: served on this computer, or as a folder that opens from disk."""

from pomona.view.correct import Corrector
from pomona.view.export import FolderOptions, export_folder
from pomona.view.reading import read_survey
from pomona.view.server import SurveyPages, ViewServer
from pomona.view.truth import truth_data

__all__ = ["Corrector", "FolderOptions", "SurveyPages", "ViewServer", "export_folder", "read_survey", "truth_data"]
