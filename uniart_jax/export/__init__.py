"""Articulated objects as files: URDF with textured meshes, GLB, inertia, previews and a report.
Never imports jax."""
