"""XML that strangers wrote: parsed without entities, document types or the network, and without a
limit that memory would have to find."""

from __future__ import annotations

from lxml import etree

MAX_BYTES = 16 * 2**20
# Errors of libxml2 that leave the tree as written: an unknown version number, an undeclared name
# space, a declaration (<?xml ...?>) that is not the first thing in the file.
_HARMLESS = {
    "ERR_RESERVED_XML_NAME",
    "ERR_UNKNOWN_VERSION",
    "ERR_VERSION_MISSING",  # as that of version="1"
    "NS_ERR_UNDEFINED_NAMESPACE",
    "WAR_UNKNOWN_VERSION",
}


def parse_xml(data: bytes, notes: list[str]) -> etree._Element:
    """The root element, without comments and processing instructions.

    Args:
      data: the file; read at most ``MAX_BYTES + 1`` of it.
      notes: takes up what was ignored.

    Raises:
      ValueError: empty, too large, a document type (DTD, entities), or not well formed; one line,
        without the file's name.
    """
    if not data.strip():
        raise ValueError("the file is empty")
    if len(data) > MAX_BYTES:
        raise ValueError(
            f"the file has {len(data) / 2**20:.0f} MiB, more than the {MAX_BYTES // 2**20} a "
            "description may have"
        )
    if b"<!DOCTYPE" in data.replace(b"\0", b""):  # zeros: UTF-16
        raise ValueError("it declares a document type (DTD, entities), which is refused")
    options = {"resolve_entities": False, "no_network": True, "load_dtd": False, "huge_tree": False}
    options |= {"remove_comments": True, "remove_pis": True}
    parser = etree.XMLParser(recover=True, **options)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ValueError(f"it is not XML: {error}") from None
    faults = [e for e in parser.error_log if e.type_name not in _HARMLESS]
    if root is None or faults:
        fault = f"{faults[0].message} (line {faults[0].line})" if faults else "no element"
        raise ValueError(f"it is not XML: {fault}")
    if root.getroottree().docinfo.doctype:
        raise ValueError("it declares a document type (DTD, entities), which is refused")
    if parser.error_log:
        notes.append(f"XML: {parser.error_log[0].message}: ignored")
    return root
