"""Objects of plain boxes as URDF, written without any of our exporters."""

from pathlib import Path


def urdf(*parts: str, height: float = 0.5, angle: float = 1.5) -> str:
    """A box of 1 x 1 x ``height`` and, hinged to it, a door for every other name."""
    links = [
        f'<link name="{name}"><visual><geometry><box '
        f'size="{"1 1 " + str(height) if i == 0 else "1 .1 .1"}"/></geometry></visual></link>'
        for i, name in enumerate(parts)
    ]
    joints = [
        f'<joint name="{name}_joint" type="revolute"><parent link="{parts[0]}"/><child '
        f'link="{name}"/><origin xyz="0 0 {-0.01 * i}"/><axis xyz="0 0 1"/><limit lower="0" '
        f'upper="{angle}" effort="1" velocity="1"/></joint>'
        for i, name in enumerate(parts[1:], 1)
    ]
    return f'<robot name="toy">{"".join(links + joints)}</robot>'


def write(folder: Path, *parts: str, **options) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "object.urdf").write_text(urdf(*parts, **options))
    return folder
