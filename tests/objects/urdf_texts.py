"""URDF texts by the element, for the tests of reading."""

from __future__ import annotations

from uniart_jax.objects.object import ArticulatedObject, Part

BOX = '<visual><geometry><box size="1 1 1"/></geometry></visual>'


def link(name: str, body: str = BOX) -> str:
    return f'<link name="{name}">{body}</link>'


def joint(kind: str, child: str, inner: str = "", parent: str = "base", name: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name or child + "_joint"}" type="{kind}">{ends}{inner}</joint>'


def limit(lo: float, hi: float) -> str:
    return f'<limit lower="{lo}" upper="{hi}"/>'


def mesh(file: str) -> str:
    return f'<visual><geometry><mesh filename="{file}"/></geometry></visual>'


def robot(*elements: str) -> str:
    return f'<robot name="thing">{"".join(elements)}</robot>'


def notes(obj: ArticulatedObject, words: str) -> list[str]:
    return [n for n in obj.provenance if words in n]


def has_picture(part: Part) -> bool:
    """Whether a part's visual is a texture with a picture, not a plain colour."""
    material = getattr(part.mesh.visual, "material", None)
    return getattr(material, "image", None) is not None and part.mesh.visual.uv is not None
