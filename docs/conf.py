"""Sphinx: builds the site from this folder. `sphinx-build -W -b html docs out/site`.

Nothing is loaded from outside: formulas become MathML, and no inventory of another project is asked for.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

from dexgrasp_env import __version__

project = "dexgrasp"
author = "The dexgrasp authors"
project_copyright = author
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "from_code"]
exclude_patterns = ["_extensions"]
default_role = "code"

suppress_warnings = ["ref.python"]  # fields of several classes have the same name

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # docstrings give shapes and units, which say more

html_theme = "furo"
html_title = f"dexgrasp {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
