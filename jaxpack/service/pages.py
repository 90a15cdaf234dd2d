"""Plans whose pages can be looked at, as many as there is room for."""

from collections import OrderedDict

from jaxpack.service.packing import Page


class Pages:
    """The pages that were asked for or made last, by the ids of their plans."""

    def __init__(self, most: int) -> None:
        self.most, self.size = most, 0
        self.pages = OrderedDict[str, Page]()

    def keep(self, pages: dict[str, Page]) -> None:
        """Keeps some more, in the place of those that nobody has asked for."""
        for name, page in pages.items():
            self.pages[name] = page
            self.size += _size(page)
        while self.size > self.most and self.pages:
            self.size -= _size(self.pages.popitem(last=False)[1])

    def get(self, name: str) -> Page | None:
        """The one of that id, if it is still there."""
        if name in self.pages:
            self.pages.move_to_end(name)
        return self.pages.get(name)


def _size(page: Page) -> int:
    return len(page.title) + len(page.shown)
