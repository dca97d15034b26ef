r"""Equations without a network: MathML by docutils' own converter, labels from ``\tag{E-nn}``, links from every E-nn.

``\tag`` is LaTeX that other readers of the same Markdown (GitHub, editors) show as a number too; here it becomes the
label, and every "E-24" in running text, of a page or of a docstring, becomes a link to it.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

TAG = re.compile(r"\s*\\tag\{([^}]*)\}")
LABEL = re.compile(r"(?<![\w.-])E-\d\d[a-z]?\b")
PLAIN = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.title, nodes.reference, nodes.strong,
         nodes.raw, nodes.comment, addnodes.pending_xref, addnodes.desc_signature)  # fmt: skip
"""Nothing inside these becomes a link; a bold E-nn stands where its equation is explained."""

logger = logging.getLogger(__name__)


class LabelEquations(SphinxTransform):
    r"""Take ``\tag{E-24}`` as label and number of an equation."""

    default_priority = 380

    def apply(self, **_: Any) -> None:
        """Label every tagged equation of a page."""
        domain = self.env.domains.math_domain
        for block in list(self.document.findall(nodes.math_block)):
            found = TAG.search(block.astext())
            if found is None:
                continue
            label = found.group(1)
            if label in domain.equations:
                logger.warning("the equation %s stands twice", label, location=block)
            domain.data["objects"][label] = (self.env.docname, label)  # the label itself is the number
            block["label"] = label
            block["ids"].append(nodes.make_id(f"equation-{label}"))
            block.children[:] = [nodes.Text(TAG.sub("", block.astext()))]


class LinkEquations(SphinxTransform):
    """Link every E-nn in running text to its equation."""

    default_priority = 390

    def apply(self, **_: Any) -> None:
        """Replace the text nodes of a page that hold labels."""
        for text in list(self.document.findall(nodes.Text)):
            if LABEL.search(text) and not _inside(text, PLAIN):
                text.parent.replace(text, _linked(str(text), self.env.docname))


def _inside(node: nodes.Node, kinds: tuple[type, ...]) -> bool:
    while node.parent is not None:
        node = node.parent
        if isinstance(node, kinds):
            return True
    return False


def _linked(text: str, docname: str) -> list[nodes.Node]:
    parts: list[nodes.Node] = []
    end = 0
    for found in LABEL.finditer(text):
        parts.append(nodes.Text(text[end : found.start()]))
        link = addnodes.pending_xref(
            "", nodes.inline("", found.group()), refdomain="math", reftype="eq", reftarget=found.group(),
            refdoc=docname, refwarn=True, refexplicit=False,
        )  # fmt: skip
        parts.append(link)
        end = found.end()
    return [*parts, nodes.Text(text[end:])]


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    try:
        return str(tex2mathml(node.astext(), as_block=as_block))
    except MathError as error:
        logger.warning("cannot typeset %s: %s", node.astext(), error, location=node)
        return f"<code>{node.astext()}</code>"


def visit_math(self: Any, node: nodes.math) -> None:
    """Write inline mathematics."""
    self.body.append(self.starttag(node, "span", "", CLASS="math") + _mathml(node, as_block=False) + "</span>")
    raise nodes.SkipNode


def visit_math_block(self: Any, node: nodes.math_block) -> None:
    """Write an equation with its label and a link to itself."""
    self.body.append(self.starttag(node, "div", "", CLASS="math-block", tabindex="0"))
    self.body.append(_mathml(node, as_block=True))
    if node.get("label"):
        target = nodes.make_id(f"equation-{node['label']}")
        self.body.append(f'<a class="eqno" href="#{target}" title="Link to this equation">({node["label"]})</a>')
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register renderer and transforms."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    app.add_transform(LabelEquations)
    app.add_transform(LinkEquations)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
