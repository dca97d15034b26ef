"""Our extensions of Sphinx on a page of their own: equations, their labels and links, references, link check."""

import runpy
import sys

import pytest

from checkout import ROOT

DOCS = ROOT / "docs"

PAGE = r"""# Theory

$$
E_0 = \frac{a}{b} \tag{E-01}
$$

Text with E-01, with `E-01`, with **E-01** and with UE-01; inline $x^2$.

```{eval-rst}
.. autofunction:: doppelgait.motion.make_path

:py:func:`doppelgait.motion.paths.make_path` :py:func:`doppelgait.motion.clean.clean_motion`
```
"""
CONF = """
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docstrings", "equations", "api_links"]
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
math_eqref_format = "{number}"
html_theme = "basic"
nitpicky = True
exclude_patterns = []
"""


@pytest.fixture(autouse=True, scope="module")
def _extensions():
    pytest.importorskip("sphinx")
    pytest.importorskip("myst_parser")
    sys.path.insert(0, str(DOCS / "_ext"))
    yield
    sys.path.remove(str(DOCS / "_ext"))


@pytest.fixture
def build(tmp_path):
    """Builds a page; gives the HTML and the warnings."""

    def built(text):
        from io import StringIO

        from sphinx.application import Sphinx
        from sphinx.util.docutils import docutils_namespace

        (tmp_path / "conf.py").write_text(CONF)
        (tmp_path / "index.md").write_text(text)
        warnings = StringIO()
        with docutils_namespace():
            Sphinx(
                tmp_path, tmp_path, tmp_path / "html", tmp_path / "trees", "html", status=None, warning=warnings
            ).build()
        return (tmp_path / "html" / "index.html").read_text(), warnings.getvalue()

    return built


def test_equations_become_mathml_with_label_and_links(build):
    html, warnings = build(PAGE)
    assert "<mfrac>" in html
    assert "<msup>" in html
    assert "mathjax.js" not in html
    assert 'id="equation-e-01"' in html
    assert '<a class="eqno" href="#equation-e-01" title="Link to this equation">(E-01)</a>' in html
    assert html.count('href="#equation-e-01"') == 2, "label and text; neither code, nor bold, nor another word"
    assert "tag" not in html.partition("<math")[2].partition("</math>")[0]
    assert "equation" not in warnings


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("E-99 is nowhere.", "equation not found: E-99"),
        ("$$ \\no_such \\tag{E-02} $$", "cannot typeset"),
        ("$$ a \\tag{E-02} $$\n\ntext\n\n$$ b \\tag{E-02} $$", "the equation E-02 stands twice"),
        ("{py:func}`doppelgait.motion.no_such_walk`", "no_such_walk"),
    ],
)
def test_what_is_wrong_on_a_page_is_a_warning(build, text, says):
    assert says in build(f"# Page\n\n{text}\n")[1]


def test_references_lead_to_the_public_name_and_internal_ones_are_code(build):
    html, warnings = build(PAGE)
    assert 'href="#doppelgait.motion.make_path" title="doppelgait.motion.make_path"' in html
    assert "#doppelgait.motion.clean" not in html
    assert "clean_motion()</span></code>" in html
    assert warnings == ""


def test_bars_of_magnitudes_are_no_substitutions():
    from docstrings import escape_bars

    assert escape_bars("|x| and ``|y|`` and :math:`|z|`") == r"\|x\| and ``|y|`` and :math:`|z|`"


def test_a_constant_has_the_words_below_its_assignment():
    from docstrings import words_of_constant

    from doppelgait.scene import TYPICAL_RCS_M2

    assert words_of_constant("TYPICAL_RCS_M2", TYPICAL_RCS_M2)[0].startswith("Mean total cross section of a person")


def test_the_link_check_finds_what_is_broken(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top">A</h1><a href="b.html#here">1</a><a href="#top">2</a><a href="https://example.org/x">3</a>'
        '<a href="b.html#gone">4</a><a href="c.html">5</a><a href="#nowhere">6</a><script src="https://cdn/x.js"></script>'
    )
    (tmp_path / "b.html").write_text('<p id="here">B</p><img src="a.html"><img src="data:image/png;base64,AA==">')
    wrong, pages = runpy.run_path(str(DOCS / "check_links.py"))["check"](tmp_path)
    assert len(pages) == 2
    assert sorted(wrong) == [
        "a.html: #nowhere: no such place in that page",
        "a.html: b.html#gone: no such place in that page",
        "a.html: c.html: no such file",
        "a.html: loads https://cdn/x.js",
    ]
