"""Settings of the docs: `make docs` builds them, every warning an error."""

import importlib.metadata
import sys
from pathlib import Path

import numpy as np

from glider.physics.effects import families
from glider.sysid import constants

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "drake-glider"
author = "the drake-glider authors"
version = release = importlib.metadata.version("drake-glider")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "effect_catalogue",
    "page_figures",
    "mathml",
    "plain_docstrings",
    "port_tables",
]
exclude_patterns = ["conf.py", "extensions"]
default_role = "literal"  # As Markdown has it: our docstrings are no reST.

# Notebooks are Python files with cells, as jupytext reads them, and run again in each
# build, in a folder of their own.
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_show_tb = True
nb_merge_streams = True
suppress_warnings = ["myst-nb.lexer"]  # Of notebooks in a build that runs none.

myst_enable_extensions = ["amsmath", "deflist", "dollarmath", "substitution"]
myst_heading_anchors = 3
# What the pages say of the tracer's numbers is what it has.
myst_substitutions = {
    "clear": f"{constants.CLEAR:.0f}",
    "bend_threshold": f"{np.log(len(families.FAMILIES)):.1f}",
    "block_threshold": f"{constants.EVIDENCE_THRESHOLD + constants.RIVAL_GAP:.0f}",
    "followed": f"{constants.FOLLOWED}",
    "folds": f"{constants.FOLDS}",
    "small": f"{200 * constants.RESOLVED:.0f} %",
    "slight": f"{100 * constants.SLIGHT:.0f} %",
    "mostly": f"{100 * constants.MOSTLY:.0f} %",
    "explained": f"{100 * constants.EXPLAINED:.0f} %",
    "many_flights": f"{constants.MANY_FLIGHTS}",
    "unlikely": f"{100 * constants.UNLIKELY:.2g} %",
    "moment_share": f"{constants.MOMENT_SHARE:g}",
    "gain_error": f"{constants.GAIN_ERROR:.0%}",
    "no_chance": f"{constants.NO_CHANCE:g}",
    "most_effects": f"{constants.MOST_EFFECTS}",
    "price": f"{constants.EVIDENCE_THRESHOLD:.1f}",
    "prior_scales": f"{constants.PRIOR_SCALES:g}",
    "rival_gap": f"{constants.RIVAL_GAP:.0f}",
    "tail_spread": f"{constants.TAIL_SPREAD:.0%}",
    "clock_error": f"{1e3 * constants.CLOCK_ERROR:g} ms",
    "tie": f"{constants.WORSE - 1.0:.1%}",
    "z": f"{constants.Z:.0f}",
}

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}
napoleon_use_ivar = True
napoleon_use_rtype = False

html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"drake-glider {version}"
html_static_path = ["static"]
html_css_files = ["custom.css"]
html_show_copyright = False
