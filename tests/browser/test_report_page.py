"""Pages of reports on a telephone and on a desktop."""

from doppelgait.viz.html import format_figure, format_page, format_table

PICTURE = "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='990' height='550'/>"
BOXES = "[...document.querySelectorAll('.wide, figure, pre')].map(box => box.scrollWidth > box.clientWidth)"


def test_wide_tables_figures_and_plans_scroll_in_their_boxes_and_the_page_does_not(page):
    table = format_table([{f"column {n}": "0.712 (0.600 to 0.812)" for n in range(4)}])
    parts = ["<h1>home-alarm-life-of-a-long-name-without-a-break</h1>", table, format_figure(PICTURE, "words " * 50)]
    for width_px, scrolls in ((400, True), (1200, False)):
        page.set_viewport_size({"width": width_px, "height": 900})
        page.set_content(format_page("report", [*parts, f"<pre>{'x' * 100}</pre>"]))
        assert page.evaluate("document.documentElement.scrollWidth") == width_px
        assert page.evaluate(BOXES) == [scrolls] * 3
