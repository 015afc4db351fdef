"""Passes over what networks draw. ``voxels.follow`` makes the parts of the first and calls the
last, ``passes.cleaned`` calls all between, in this order:

    primitive_parts       parts that voxels are too coarse for are made of their boxes
    flat_faces            nearly flat faces are made flat; doors become whole plates
    walls                 small holes in flat outer walls are closed
    layout_panels         shelves and dividers within the body are the layout's panels
    layout_boards         doors and drawers are the boards that the layout has
    trays                 racks behind doors become trays
    layout_legs           the body stands on the legs or the plinth that the layout has,
    straight_legs         or, where the layout tells of none, legs are made whole and straight
    rooms                 rooms behind doors and in drawers become boxes with flat walls
    round_doors           round doors are cut to discs
    drums                 drums become shells behind a round hole
    solids_of_revolution  parts that are round get the outlines that the layout has, or voxels show
    told_shapes           boards of parts that stand still, and tubes, as the layout tells them
    loose_parts           specks are left out; a part that a pass took away whole is put back
    room_to_move          what stands in the way of a moving part is taken off
    loose_parts           parts that hang in the air are moved until they touch the others

Each takes a ``DenseField`` (``isosurface``), or meshes, and returns another. Arguments come in one
order, of which each takes what it needs: field, boxes, joints, parents, body (parts that no joint
moves), then what is its own. ``assemble``, which has no layout, calls ``loose_parts`` alone.

Modules that are no passes, and the passes that use them:

    align_open_parts      open parts turned until they lie straight (flat_faces, layout_boards,
                          round_doors, fronts)
    column_maps           faces seen from one side, column by column (flat_faces, rooms)
    fronts                where doors and drawers close (flat_faces, rooms, drums)
    frames                what surrounds doors and drawers is made flat (rooms)
    drawn_outline         the outline that voxels show of a round part (solids_of_revolution)
"""
