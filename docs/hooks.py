"""What `mkdocs build` is told besides `mkdocs.yml`: pages outside this folder, fields of classes.

On the site as in the repository a link names a file by its path: pages may be anywhere in it, and
pictures and tables that they link to come along.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
OUTSIDE = ("CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "benchmarks/NOTES.md")
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")


def repository_path(page: str) -> str:
    """Where the file of a page is."""
    if page == "index.md":
        return "README.md"
    return page if page in OUTSIDE else f"docs/{page}"


def site_path(file: str) -> str:
    """Where a file of the repository is on the site."""
    return "index.md" if file == "README.md" else file.removeprefix("docs/")


def linked(page: str, link: str) -> str:
    """The file of the repository that a link on a page names."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(repository_path(page)), link))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages outside this folder, and the files that any page links to."""
    pages = ["index.md", *OUTSIDE, *(file.src_uri for file in files.documentation_pages())]
    found = {"README.md", *OUTSIDE}
    for page in pages:
        if page.endswith(".md"):
            text = (ROOT / repository_path(page)).read_text(encoding="utf-8")
            found.update(linked(page, link) for link in LINK.findall(text))
    for file in sorted(found):
        if not file.startswith("docs/") and (ROOT / file).is_file():
            source = str(ROOT / file)
            files.append(File.generated(config, site_path(file), abs_src_path=source))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Points links at where their files are on the site."""
    here = page.file.src_uri
    if not here.endswith(".md"):
        return markdown

    def moved(link: re.Match) -> str:
        there = site_path(linked(here, link[1]))
        return posixpath.relpath(there, posixpath.dirname(here) or ".")

    return LINK.sub(moved, markdown)


class Fields(griffe.Extension):
    """The fields of a class as one list, each with the comment beside it or above it."""

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Takes the fields that the class's docstring does not list already."""
        told, lines = cls.docstring.value if cls.docstring else "", []
        for name, field in cls.members.items():
            if not isinstance(field, griffe.Attribute) or "property" in field.labels:
                continue
            text = field.docstring.value if field.docstring else comment(field)
            if f"\n    {name}: " not in told and text:
                lines.append(f"    {name}: {' '.join(text.split())}")
            field.docstring = None  # not said twice
        if lines and cls.docstring:
            cls.docstring.value = "\n".join([told, "", "Attributes:", *lines])


def comment(field: griffe.Attribute) -> str:
    """What the source says of a field."""
    lines = field.lines_collection[field.filepath]
    _, beside, text = lines[field.endlineno - 1].partition("  # ")
    if beside:
        return text
    first = above = field.lineno - 1
    while lines[above - 1].lstrip().startswith("# "):
        above -= 1
    return " ".join(line.strip(" #") for line in lines[above:first])
