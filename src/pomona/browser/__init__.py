"""What people use in a browser: the view of a survey, the app, and a count while photos arrive."""
