"""What MkDocs needs beside its plugins: notebooks as pages, files that pages link to, and a site without network."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

REPOSITORY = Path(__file__).parents[1]
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)\s#]+)(#[^)\s]*)?(?=\))")
OUTSIDE = "repository"  # the folder of the site for files that are not in docs/
# What a browser fetches on its own; a link that a reader clicks is none of it.
FETCHED = {"script", "img", "iframe", "source", "video", "audio"}
FETCHED_LINKS = {"stylesheet", "preload", "preconnect", "prefetch", "dns-prefetch", "icon", "modulepreload", "manifest"}
STYLE_FETCHES = re.compile(r"""(?:@import\s+|url\(\s*)["']?((?:https?:)?//[^"')\s]+)""")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add notebooks as pages, and the files outside docs/ that pages link to."""
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        for file in _page_of(notebook, config):
            files.append(file)
    waiting = [(_source(page, config), page.content_string) for page in files.documentation_pages()]
    while waiting:
        source, text = waiting.pop()
        for path, _ in LINK.findall(text):
            target = (source.parent / path).resolve()
            uri = _uri(target, config)
            if uri is None or files.get_file_from_path(uri) is not None:
                continue
            files.append(File.generated(config, uri, abs_src_path=str(target)))
            if target.suffix == ".md":
                waiting.append((target, target.read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links to notebooks to their pages, and links out of docs/ to the copy in the site."""
    source = _source(page.file, config)
    here = posixpath.dirname(page.file.src_uri) or "."

    def led(match: re.Match[str]) -> str:
        uri = _uri((source.parent / match[1]).resolve(), config)
        return match[0] if uri is None else posixpath.relpath(uri, here) + (match[2] or "")

    return LINK.sub(led, markdown)


def _page_of(notebook: File, config: MkDocsConfig) -> Iterator[File]:
    """Yield the page of a notebook as it was saved, outputs included, and the pictures in it."""
    uri = notebook.src_uri.removesuffix(".ipynb")
    name = posixpath.basename(uri)
    text, resources = MarkdownExporter().from_filename(
        str(_source(notebook, config)), {"output_files_dir": f"{name}_files"}
    )
    title, _, rest = text.partition("\n")
    note = f'<a href="{name}.ipynb" download>This page as a notebook</a>'
    yield File.generated(config, f"{uri}.md", content=f"{title}\n\n{note}\n{rest}")
    for path, content in resources["outputs"].items():
        yield File.generated(config, posixpath.join(posixpath.dirname(uri), path), content=content)


def _source(page: File, config: MkDocsConfig) -> Path:
    """Return the file to which the links of a page are relative."""
    return Path(page.abs_src_path or Path(config.docs_dir, page.src_uri)).resolve()


def _uri(target: Path, config: MkDocsConfig) -> str | None:
    """Return the place in the site of a file of the repository, None of what is no such file."""
    if not target.is_file() or not target.is_relative_to(REPOSITORY):
        return None
    if target.is_relative_to(config.docs_dir):
        within = target.relative_to(config.docs_dir)
        return (within.with_suffix(".md") if within.suffix == ".ipynb" else within).as_posix()
    return f"{OUTSIDE}/{target.relative_to(REPOSITORY).as_posix()}"


class _Fetches(HTMLParser):
    """What a page has the browser fetch from another host."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the addresses of one element."""
        values = dict(attrs)
        fetched = [values.get("src")] if tag in FETCHED else []
        if tag == "link" and FETCHED_LINKS & set((values.get("rel") or "").split()):
            fetched.append(values.get("href"))
        self.found += [address for address in fetched if address and re.match(r"(https?:)?//", address)]


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a site that would ask another host for a script, a font, a style or a picture."""
    wrong = []
    for path in Path(config.site_dir).rglob("*"):
        if path.suffix not in (".html", ".css"):
            continue
        text = path.read_text(encoding="utf-8")
        found = STYLE_FETCHES.findall(text)
        if path.suffix == ".html":
            parser = _Fetches()
            parser.feed(text)
            found += parser.found
        wrong += [f"{path.relative_to(config.site_dir)} fetches {address}" for address in found]
    if wrong:
        raise PluginError("The site must need no network:\n" + "\n".join(wrong))
