"""Passes over what networks draw. ``voxels.follow`` makes the parts of the first and calls the
last, ``passes.cleaned`` calls all between, in this order:

    primitive_parts  parts that voxels are too coarse for are made of their boxes
    flat_faces       nearly flat faces are made flat; doors become whole plates
    walls            small holes in flat outer walls are closed
    found_panels     shelves and dividers within the body are the layout's panels
    found_boards     doors and drawers are the boards that the layout has
    trays            racks behind doors become trays
    found_legs       the body stands on the legs or the plinth that the layout has,
    legs             or, where the layout tells of none, legs are made whole and straight
    rooms            rooms behind doors and in drawers become boxes with flat walls
    round_doors      round doors are cut to discs
    drums            drums become shells behind a round hole
    solids_of_revolution  parts that are round get the outlines that the layout has, or voxels show
                     (drawn_outline)
    loose_parts      specks are left out; a part that a pass took away whole is put back
    clearance        what stands in the way of a moving part is taken off
    loose_parts      parts that hang in the air are moved until they touch the others

Each takes a ``DenseField`` (``isosurface``), or meshes, and returns another. Several passes share
``align_open_parts`` (open parts, turned until they lie straight) and ``fronts`` (where doors and
drawers close). ``assemble``, which has no layout, calls ``loose_parts`` alone.
"""
