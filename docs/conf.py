"""Sphinx configuration: Markdown pages, and notebooks that are run when the pages are built."""

project = "libmpm"
copyright = "the libmpm authors"
extensions = ["myst_nb"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "libmpm"
# A notebook that fails, fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 180
