"""What the provenance report says of a figure: the caption that was written when it was drawn."""

import json
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Captions:
    """Captions of a folder of figures, read when they are asked for.

    As a job's parameter it starts no job again, because Snakemake compares plain values alone, and a
    caption that is asked for in a template is the one that is there by then.

    Parameters
    ----------
    folder
        Where the figures and their ``captions.json`` are.
    """

    folder: str

    def title(self, figure: str) -> str:
        """Return a figure's title, its name where it has none yet."""
        return self._of(figure).get("title", figure)

    def heading(self, figure: str) -> str:
        """Return a figure's title as reStructuredText."""
        return escaped(self.title(figure))

    def caption(self, figure: str) -> str:
        """Return a figure's caption as reStructuredText."""
        return escaped(self._of(figure).get("caption", ""))

    def alt(self, figure: str) -> str:
        """Return what a figure shows, for readers who cannot see it, as reStructuredText."""
        return escaped(self._of(figure).get("alt", ""))

    def _of(self, figure: str) -> dict[str, str]:
        path = Path(self.folder) / "captions.json"
        if not path.is_file():
            return {}
        lines: list[dict[str, str]] = json.loads(path.read_text(encoding="utf-8"))
        return next((line for line in lines if line["name"] == figure), {})


def escaped(text: str) -> str:
    """Return a text that reStructuredText shows as it is."""
    return "".join("\\" + letter if letter in "\\*`|_[]<>" else letter for letter in text)


def label(text: str) -> str:
    """Return a text as a label of the report, in which braces would be wildcards."""
    return text.replace("{", "(").replace("}", ")")
