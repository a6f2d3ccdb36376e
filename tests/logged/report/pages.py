"""A page as a reader has it: its words, tables and pictures, and what it would ask a network for."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "br", "hr", "img", "input", "link"}


class Page(HTMLParser):
    """A page that was read.

    Attributes:
        tags: (name, attributes) in order. text: all words that are no style. tables: lines of cells of each.
        pictures: alternative texts. open: tags that were not closed.
    """

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.style = "", ""
        self.tables: list[list[list[str]]] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "small":
            self.handle_data(" ")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1] == tag, f"</{tag}> closes <{self.open[-1]}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            self.style += data
            return
        self.text += data
        if {"td", "th"} & set(self.open):
            self.tables[-1][-1][-1] += data

    @property
    def pictures(self) -> list[str]:
        return [str(attributes["aria-label"]) for _, attributes in self.tags if attributes.get("role") == "img"]

    def table(self, first: str) -> list[dict[str, str]]:
        """The lines of the table whose first column is so called."""
        for head, *lines in self.tables:
            if head[0] == first:
                return [dict(zip(head, line, strict=True)) for line in lines]
        raise AssertionError(f"no table begins with {first!r}: {[one[0] for one in self.tables]}")


def asked_for(page: Page) -> list[str]:
    """What a browser would load: addresses that are no place in the page."""
    places = [
        str(value)
        for _, attributes in page.tags
        for name, value in attributes.items()
        if name in ("src", "href", "xlink:href", "srcset", "action", "data", "poster")
        and not str(value).startswith("#")
    ]
    styles = [page.style, *(str(attributes.get("style", "")) for _, attributes in page.tags)]
    return places + [one for one in styles if "@import" in one or "url(" in one.replace("url(#", "")]
