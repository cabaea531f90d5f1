"""Metadata in XML: values by name, with errors that say the file, the name and the remedy."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from typing import overload

from skyscatter.dehaze.rasters.base import finite_number
from skyscatter.dehaze.rasters.containers import Container
from skyscatter.errors import MissingDataError

_REMEDY = "get the product again"


class Metadata:
    """One XML file of a product.

    Raises
    ------
    MissingDataError
        If it is not whole XML, or a value is missing that is asked for without a default.
    """

    def __init__(self, box: Container, name: str) -> None:
        self.name, self.shown = name, box.show(name)
        try:
            self.root = ElementTree.fromstring(box.read(name))
        except ElementTree.ParseError as error:
            raise MissingDataError(self.shown, f"is not whole XML ({error}); {_REMEDY}") from error

    def all(self, tag: str) -> Iterator[ElementTree.Element]:
        """All elements of that name, wherever they stand."""
        return self.root.iter(tag)

    def text(self, tag: str, default: str | None = None) -> str:
        """Text of the first element of that name that has one."""
        for element in self.root.iter(tag):
            if element.text and element.text.strip():
                return element.text.strip()
        if default is None:
            raise MissingDataError(self.shown, f"has no {tag}; {_REMEDY}")
        return default

    @overload
    def number(self, tag: str) -> float: ...

    @overload
    def number(self, tag: str, default: None) -> float | None: ...

    def number(self, tag: str, default: float | str | None = "") -> float | None:
        """Number in the first element of that name."""
        text = self.text(tag, "")
        value = finite_number(text)
        if value is None and (text or default == ""):
            raise MissingDataError(self.shown, f"{tag} = {text!r}: must be a number; {_REMEDY}")
        return value

    def numbers_by(self, tag: str, key: str) -> dict[str, float]:
        """Numbers of all elements of that name, by one of their attributes."""
        values = {}
        for element in self.root.iter(tag):
            value = finite_number(element.text)
            if value is None:
                raise MissingDataError(self.shown, f"{tag} = {element.text!r}: must be a number; {_REMEDY}")
            values[element.get(key, "")] = value
        return values
