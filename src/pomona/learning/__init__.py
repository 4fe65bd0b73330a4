"""How networks come to see fruits: rows rendered with truth, training, and what a survey teaches itself."""
