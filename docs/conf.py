"""Sphinx configuration: Markdown pages, and notebooks that are run when the pages are built."""

import os
import re
import sys
from pathlib import Path

from sphinx.ext import napoleon

# In a source tree whose modules have been built in place, the pages and the kernels of the
# notebooks are of that tree; else of the package that is installed.
_tree = Path(__file__).resolve().parent.parent / "python"
if any((_tree / "libmpm").glob("_core.*.so")):
    sys.path.insert(0, str(_tree))
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [str(_tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    )

project = "libmpm"
copyright = "the libmpm authors"
extensions = ["myst_nb", "sphinx.ext.autodoc"]
exclude_patterns = ["_build", "README.md"]  # that page is for readers on a forge
html_theme = "furo"
html_title = "libmpm"
# A notebook that fails, fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 180
# Notebooks show their figures, whatever backend the caller has chosen for others.
os.environ.pop("MPLBACKEND", None)
# Formulas between dollars, also in notebooks.
myst_enable_extensions = ["amsmath", "dollarmath"]
# Docstrings: a name in single backticks links to its entry, where there is one.
default_role = "py:obj"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    "npt.ArrayLike": "numpy.typing.ArrayLike",
    "npt.NDArray": "numpy.ndarray",
    "NDArray": "numpy.ndarray",
}

_NUMPY_STYLE = napoleon.Config(napoleon_use_param=False, napoleon_use_rtype=False)
_COMBINING = re.compile(r"(\S*[\u0300-\u036f]\S*)")


def _plain(line):
    """Return a line in which bars and stars outside of backticks mean themselves."""
    parts = re.split(r"(``.*?``|`.*?`)", line)
    parts[::2] = [part.replace("|", r"\|").replace("**", r"\*\*") for part in parts[::2]]
    return "".join(parts)


def _to_rst(app, what, name, obj, options, lines):
    """Make reStructuredText of docstrings that are written to be read as they are."""
    if any(re.fullmatch(r"\s*-{4,}", line) for line in lines):
        text = napoleon.NumpyDocstring("\n".join(lines), _NUMPY_STYLE, app, what, name, obj)
        lines[:] = str(text).splitlines()
    ruled = [i for i, line in enumerate(lines) if re.fullmatch(r"\s*={3,}[= ]*", line)]
    for i, line in enumerate(lines):
        if ruled and ruled[0] <= i <= ruled[-1]:
            # docutils counts what is seen, the tables count characters.
            lines[i] = _COMBINING.sub(lambda m: m[1] + " " * _marks(m[1]), line)
        else:
            lines[i] = _plain(line)


def _marks(word):
    return sum("\u0300" <= letter <= "\u036f" for letter in word)


def _skip(app, what, name, obj, skip, options):
    """Leave out what values say to messages and to the engine, and fields of plain tuples."""
    unwanted = name in ("kind", "label") or type(obj).__name__ == "_tuplegetter"
    return True if unwanted else None


def setup(app):
    """Connect the two."""
    app.connect("autodoc-process-docstring", _to_rst)
    app.connect("autodoc-skip-member", _skip)
