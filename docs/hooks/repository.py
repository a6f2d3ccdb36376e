"""What lies outside of docs/: the README is the first page, files of the repository are linked, their code is shown."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(?<=\]\()\.\./([^)#\s]+)")  # from a page in docs/ to a file beside it
HOME = re.compile(r"(?<=\]\()(?!https?:|#)([^)\s]+)")  # from the README

CODE = re.compile(r"^<!-- code: (\S+?)(?: (\w+))? -->$", re.M)  # a file, or a class or function of it


def shown(path: str, name: str | None) -> str:
    """A file of the repository, or a class or function of it, in a fence.

    Raises:
        ValueError: there is no such thing in it.
    """
    text = (ROOT / path).read_text(encoding="utf-8")
    if name is not None:
        found = [node for node in ast.parse(text).body if getattr(node, "name", None) == name]
        if not found:
            raise ValueError(f"{path} has no {name}")
        text = "\n".join(text.splitlines()[found[0].lineno - 1 : found[0].end_lineno])
    language = {".py": "python", ".yaml": "yaml"}.get(Path(path).suffix, "text")
    return f'```{language} title="{path}"\n{text.strip()}\n```'


def moved(path: str) -> str:
    """Where a file of the repository lies on the site; a folder is its files."""
    return f"files/{path.rstrip('/')}"


def home() -> str:
    """The README as a page of docs/."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return HOME.sub(r"../\1", text).replace("](../docs/", "](")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the README, and every file that a page links."""
    files.append(File.generated(config, "index.md", content=home()))
    pages = [file.content_string for file in files.documentation_pages()]
    for path in sorted({link for text in pages for link in LINK.findall(text)}):
        if (ROOT / path).is_file():  # else the link stays, and is reported
            text = (ROOT / path).read_text(encoding="utf-8")
            files.append(File.generated(config, f"{moved(path)}.txt", content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show code, and point links at where those files lie."""
    up = "../" * page.file.src_uri.count("/")

    def link(found: re.Match[str]) -> str:
        name = f"{moved(found[1])}.txt"
        return f"{up}{name}" if files.get_file_from_path(name) else found[0]

    return LINK.sub(link, CODE.sub(lambda found: shown(found[1], found[2]), markdown))
