"""Sphinx configuration: Markdown pages, no code is run and libmpm need not be installed."""

project = "libmpm"
copyright = "the libmpm authors"
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "libmpm"
