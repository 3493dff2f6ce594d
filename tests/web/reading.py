"""A page as its markup says it is, without a browser."""

from html.parser import HTMLParser

LINKS = ("href", "src", "srcset", "data-plot", "data-audio")


class Markup(HTMLParser):
    """Every tag of a page with its attributes, every address it names, ids for anchors, and its words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.links: set[str] = set()
        self.forms: set[str] = set()
        self.ids: set[str] = set()
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attributes}
        self.tags.append((tag, given))
        self.ids |= {given["id"]} if given.get("id") else set()
        self.links |= {given[name] for name in LINKS if given.get(name)}
        if tag == "form" and given.get("action"):
            self.forms.add(given["action"])

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def count(self, tag: str, **wanted: str) -> int:
        """How many tags have these attributes; a class is wanted among others."""
        return sum(
            name == tag and all(value in given.get(key.rstrip("_"), "").split() for key, value in wanted.items())
            for name, given in self.tags
        )
