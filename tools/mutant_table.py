"""Lines that ``mutants.py`` breaks, each with the test that must then fail."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """``text`` of ``file`` becomes ``replacement``; ``test`` (pytest's name for it) must then
    fail."""

    file: str
    text: str
    replacement: str
    test: str


AGGREGATION = "uniart_jax/models/aggregation.py"
FRAMES = "uniart_jax/voxels/cleanup/frames.py"
PROGRAM_CACHE = "uniart_jax/runtime/program_cache.py"
DINOV2 = "uniart_jax/models/dinov2.py"
SAMPLERS = "uniart_jax/inference/samplers.py"
VAE_LOSSES = "uniart_jax/training/vae_losses.py"
SESSIONS = "uniart_jax/app/sessions.py"
SHARED = "tests/app/test_app_sessions.py::test_what_two_sessions_uploaded_goes_with_the_last"
TAKEN = "tests/app/test_app_sessions.py::test_files_of_others_are_not_taken"
EQUATION = "tests/models/test_uniart_vae.py::test_the_attention_is_the_papers_equation_in_float64"
SUM = "tests/training/test_losses.py::test_the_vaes_loss_is_the_weighted_sum_of_its_terms"
DECAY = "tests/training/test_step.py::test_the_average_follows_its_decay_over_several_steps"
POSITIONS = "tests/models/test_dinov2.py::test_positions_are_interpolated_as_pytorch_does"
NAP, EXPORT_NAP = "uniart_jax/objects/nap.py", "tools/export_nap.py"
MOVES = "tests/objects/test_nap.py::test_parts_move_as_nap_moves_them"
READ = "uniart_jax/voxels/read_layout.py"
KNOBS = "tests/voxels/test_layout_table.py::test"
BACKS = "uniart_jax/export/plate_backs.py"
OF_BACKS = "tests/export/test_plate_backs.py::test"
UNITS = "tests/inference/test_samplers.py::test_samples_are_given_the_latents_mean_and_deviation"
OUTSIDE = "tests/inference/test_samplers.py::test_outside_its_interval_guidance_changes_nothing"
INTERVAL = (
    "tests/flow/test_rectified_flow.py::test_outside_its_interval_the_condition_alone_is_asked_for"
)
PHOTOGRAPHS = "uniart_jax/data/photographs.py"
REFRAMED = "tests/data/test_photographs.py::test_the_camera_code_is_that_of_the_new_crop"
DRUMS, ROOMS = "uniart_jax/voxels/cleanup/drums.py", "uniart_jax/voxels/cleanup/rooms.py"
LAYOUT_PANELS = "uniart_jax/voxels/cleanup/layout_panels.py"
LAYOUT_BOARDS = "uniart_jax/voxels/cleanup/layout_boards.py"
SCENES = "uniart_jax/data/scenes.py"
FRONTS, MASKS = "uniart_jax/voxels/cleanup/fronts.py", "uniart_jax/inference/masks.py"
IS_DRUM = "tests/voxels/cleanup/test_drums.py::test_what_is_no_drum_is_left"
BEHIND_DOOR = "tests/voxels/cleanup/test_drums.py::test_the_plate_lies_behind_the_closed_door"
ROUND = "tests/voxels/cleanup/test_drums.py::test_a_torn_drum_and_its_hole_are_round"
BEFORE = "tests/stages/test_before_training.py"
POOL_LOSSES = "tools/pool_losses.py"
MUTANTS = (
    Mutant(DRUMS, "return FULL * drum", "return NARROW * drum", BEHIND_DOOR),
    Mutant(DRUMS, "plane = plane if door is None else max(plane, door + 1)", "", BEHIND_DOOR),
    Mutant(DRUMS, "return max(front, end + APART)", "return front", BEHIND_DOOR),
    Mutant(DRUMS, "if _around(cells[:, across] - middle, radius) < AROUND:", "if False:", IS_DRUM),
    Mutant(DRUMS, "if not _encloses(still, middle, radius, low, high):", "if False:", IS_DRUM),
    Mutant(DRUMS, "wall = np.maximum(outside, -inside)", "wall = outside", ROUND),
    Mutant(
        FRONTS,
        "_trim(field, part, drawer, plane, depth)\n    return",
        "return",
        "tests/voxels/cleanup/test_drawers.py"
        "::test_nothing_stands_out_from_the_edges_of_a_drawers_front",
    ),
    Mutant(
        ROOMS,
        "        _straight_tops(solid, room, fill, clear)\n",
        "        pass\n",
        "tests/voxels/cleanup/test_drawers.py::test_the_walls_of_a_drawer_end_at_one_height",
    ),
    Mutant(
        LAYOUT_PANELS,
        "    if not _agree(field.sdf < 0, solid, distance, legs):\n",
        "    if False:\n",
        "tests/voxels/cleanup/test_layout_panels.py::test_panels_of_another_body_are_not_taken",
    ),
    Mutant(
        LAYOUT_PANELS,
        "GAP, OVER = 12.0, 3.0",
        "GAP, OVER = 12.0, 12.0",
        "tests/voxels/cleanup/test_layout_panels.py::test_what_is_true_is_not_cut",
    ),
    Mutant(
        "uniart_jax/inference/layouts.py",
        '"panel_rows": mirror_corners,',
        '"panel_rows": lambda rows: rows,',
        "tests/inference/test_layout_predictor.py::test_mirrored_twice_is_as_before",
    ),
    Mutant(
        "uniart_jax/data/layouts.py",
        "panels = panels_of(obj, legs)",
        "panels = panels_of(closed, legs)",
        "tests/data/test_layouts.py::test_panels_are_those_of_the_shown_state",
    ),
    Mutant(
        "uniart_jax/inference/layouts.py",
        "((one, a), (other, b))",
        "((one, a), (other, a))",
        "tests/inference/test_layout_predictor.py::"
        "test_boards_are_averaged_with_those_of_the_same_part",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "    shown = np.moveaxis(solid, axis, 0)[layers]\n",
        "    layers = slice(None)\n    shown = np.moveaxis(solid, axis, 0)\n",
        "tests/voxels/cleanup/test_layout_boards.py::test_a_back_does_not_stand_for_a_front",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "            boards[whole, axis + 3] += shift\n",
        "",
        "tests/voxels/cleanup/test_layout_boards.py"
        "::test_walls_of_a_drawer_that_is_drawn_narrower_move_as_they_are",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/trays.py",
        "        if plate and side * (np.median(door[:, axis]) - front) > 0:\n",
        "        if plate:\n",
        "tests/voxels/cleanup/test_trays.py::test_what_no_door_covers_is_no_rack",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/layout_legs.py",
        "far & (before > FEW * after)",
        "far & (before > 9 * after)",
        "tests/voxels/cleanup/test_layout_legs.py"
        "::test_a_board_within_a_body_that_is_drawn_to_the_floor_is_not_where_it_begins",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/layout_legs.py",
        "np.minimum(tops + max(end - told, 0), end)",
        "np.minimum(tops + end - told, end)",
        "tests/voxels/cleanup/test_layout_legs.py"
        "::test_a_leg_that_is_told_short_stays_where_the_others_are_told_too_long",
    ),
    Mutant(
        "uniart_jax/inference/certainty.py",
        "(np.minimum(apart, FAR) * weights).sum() / total",
        "np.minimum(apart, FAR).mean()",
        "tests/inference/test_certainty.py::test_rows_that_do_not_exist_hardly_count",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/layout_legs.py",
        "    alone = alone and not _on_others(",
        "    alone = alone or _on_others(",
        "tests/voxels/cleanup/test_layout_legs.py::test_plates_that_are_drawn_in_their_stead_stay",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/primitive_parts.py",
        "box[5] <= LOW * box[3:5].min()",
        "True",
        "tests/voxels/cleanup/test_primitive_parts.py::test_which_rows_need_one",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "    shown[seen] /= np.maximum(light, DARKEST)[:, None]\n",
        "    shown[seen] /= np.median(light)\n",
        "tests/export/test_picture_colors.py::test_light_is_what_the_renderer_has_there",
    ),
    Mutant(
        "uniart_jax/export/hidden_colors.py",
        "out[:, : count + 1], -30.0)",
        "out[:, : count + 1], 0.0)",
        "tests/export/test_hidden_colors.py"
        "::test_without_weights_all_that_is_there_counts_the_same",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "    _joined(placed)\n",
        "",
        "tests/voxels/cleanup/test_layout_boards.py"
        "::test_boards_that_hang_in_the_air_reach_the_door",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "    _as_wide(placed, drawn, [a for a in range(3) if a != axis])\n",
        "",
        "tests/voxels/cleanup/test_layout_boards.py::test_a_door_is_as_wide_as_it_is_drawn",
    ),
    Mutant(
        "uniart_jax/voxels/closed_pose.py",
        "xp.where(volumes[1] < volumes[0], angles[..., 1], angles[..., 0])",
        "angles[..., 0]",
        "tests/voxels/test_closed_pose.py::test_procedural_doors_close",
    ),
    Mutant(
        "uniart_jax/models/box_sets.py",
        "read_boxes(seen.map, corners, seen.camera, motions, gather=True)",
        "read_boxes(seen.map, corners, seen.camera, gather=True)",
        "tests/models/test_box_sets.py::test_boards_of_an_open_door_are_read_where_it_is_shown",
    ),
    Mutant(
        "uniart_jax/inference/mirror_average.py",
        "sdf=(grid.sdf + sdf) / 2",
        "sdf=grid.sdf",
        "tests/inference/test_mirror_average.py::test_a_mirrored_picture_gives_the_mirror_image",
    ),
    Mutant(
        ROOMS,
        "                straighten_rim(field, body, fronts[-1])\n",
        "",
        "tests/voxels/cleanup/test_drawers.py"
        "::test_the_frame_around_a_closed_drawers_front_is_straight_and_that_of_an_open_one_stays",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "            if free.mean() < CRUMBS:\n",
        "            if False:\n",
        "tests/voxels/cleanup/test_layout_boards.py"
        "::test_the_body_has_nothing_in_a_drawer_and_keeps_its_outer_walls",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "            kept |= _standing_out(found, solid, *way)\n",
        "            pass\n",
        "tests/voxels/cleanup/test_layout_boards.py"
        "::test_a_handle_that_has_no_board_stays_and_a_ragged_front_does_not",
    ),
    Mutant(
        LAYOUT_BOARDS,
        "found, rooms[k] = _between_walls(found, held, *way)",
        "_, rooms[k] = _between_walls(found, held, *way)",
        "tests/voxels/cleanup/test_layout_boards.py"
        "::test_a_drawer_stays_between_walls_that_are_not_the_bodys_ends",
    ),
    Mutant(
        "uniart_jax/training/panel_loss.py",
        "counts = jnp.where(share >= TRUSTED, counts, -1)",
        "",
        "tests/training/test_panel_loss.py"
        "::test_boards_that_are_little_of_a_part_pay_for_the_share",
    ),
    Mutant(
        SCENES,
        "framed(mask, width, 0)",
        "framed(mask, width, 255)",
        "tests/data/test_scenes.py::test_a_margin_is_no_object_and_frames_some_pictures",
    ),
    Mutant(
        SCENES,
        "usual = CLOSE",
        "pass",
        "tests/data/test_scenes.py::test_some_objects_fill_the_picture_and_whole_ones_do_not",
    ),
    Mutant(
        MASKS,
        "np.where(within, 255,",
        "np.where(within, mask,",
        "tests/inference/test_masks.py::test_what_is_hardly_seen_within_an_object_is_the_object",
    ),
    Mutant(
        MASKS,
        "kept |= small[around] & ~found",
        "pass",
        "tests/inference/test_masks.py::test_small_holes_are_closed_and_large_ones_stay",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "FACING = (0.1, 0.35)",
        "FACING = (0.1, 0.5)",
        "tests/export/test_picture_colors.py"
        "::test_a_top_that_is_seen_at_a_low_angle_takes_the_pictures_colour",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "FACING = (0.1, 0.35)",
        "FACING = (0.15, 0.35)",
        "tests/export/test_picture_colors.py"
        "::test_a_place_that_is_seen_at_a_cosine_of_an_eighth_is_believed_a_little",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "EDGE = 0.015",
        "EDGE = 0.025",
        "tests/export/test_picture_colors.py"
        "::test_a_place_some_pixels_within_the_silhouette_is_believed",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/align_open_parts.py",
        "    moved, colored = np.ones(shape, np.float32)",
        "    moved, colored = np.zeros(shape, np.float32)",
        "tests/voxels/cleanup/test_align_open_parts.py"
        "::test_a_part_that_does_not_turn_is_copied_as_it_would_be_interpolated",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "shown /= np.maximum(shown.max(-1, keepdims=True), 1)",
        "shown = np.clip(shown, 0, 1)",
        "tests/export/test_picture_colors.py::test_what_light_would_make_too_bright_keeps_its_hue",
    ),
    Mutant(
        MASKS,
        "(plain + mirrored[:, ::-1]) / 2",
        "plain",
        "tests/inference/test_masks.py::test_the_mask_of_a_mirror_image_is_the_mirrored_mask",
    ),
    Mutant(
        "uniart_jax/data/backdrops.py",
        "rng.random() < SHARE",
        "rng.random() < 0",
        "tests/data/test_backdrop_pictures.py::test_trainings_see_pictures_besides_others",
    ),
    Mutant(PHOTOGRAPHS, "code[3] /= ratio", "code[3] *= ratio", REFRAMED),
    Mutant(PHOTOGRAPHS, "(code[5:7] + shift) / ratio", "code[5:7] / ratio", REFRAMED),
    Mutant(
        POOL_LOSSES,
        "cameras = jnp.where(taken[:, None],",
        "cameras = jnp.where(flow_sees[:, None],",
        "tests/test_pool_tools.py::test_the_pools_mirror_is_that_of_records",
    ),
    Mutant(
        POOL_LOSSES,
        "mask = jnp.where(flip, mask[:, :, ::-1], mask)",
        "mask = jnp.where(flip, mask, mask)",
        "tests/test_pool_tools.py::test_the_pools_scenes_keep_their_masks",
    ),
    Mutant(
        "tools/train_pool.py",
        "0 * c if kept else factor * c",
        "factor * c",
        "tests/test_pool_tools.py::test_what_a_stage_freezes_stays_as_it_is",
    ),
    Mutant(
        AGGREGATION,
        "(self.to_q(articulation), k, v)",
        "(0 * self.to_q(articulation), k, v)",
        EQUATION,
    ),
    Mutant(AGGREGATION, "[geometry, fused + articulation]", "[geometry, fused]", EQUATION),
    Mutant(AGGREGATION, "articulation + self.part_feature(", "articulation + 0 * self.part_feature(", EQUATION),  # noqa: E501
    Mutant(VAE_LOSSES, "weights.articulation * sum(", "1.0 * sum(", SUM),
    Mutant(VAE_LOSSES, "+ weights.kl * kl", "+ kl", SUM),
    Mutant(VAE_LOSSES, "weights.part_feature * restored", "0 * restored", SUM),
    Mutant(
        "uniart_jax/training/losses.py",
        "jnp.exp(logvar) - 1.0 - logvar",
        "jnp.exp(logvar) - 1.0 + logvar",
        "tests/training/test_losses.py::test_kl_is_the_closed_form_of_two_gaussians",
    ),
    Mutant(
        "uniart_jax/training/flow_losses.py",
        "weights.decoded_structure * (",
        "0 * (",
        "tests/models/test_occupancy_refiner.py"
        "::test_the_flow_learns_from_what_its_sample_decodes_to",
    ),
    Mutant(
        "uniart_jax/voxels/isosurface.py",
        "2 * last - before",
        "last",
        "tests/voxels/test_assemble.py::"
        "test_what_no_voxel_shows_is_room_behind_flush_walls_and_solid_below_a_skin",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "(outside < NEAR) & ~within",
        "(outside < NEAR)",
        "tests/voxels/cleanup/test_solids_of_revolution.py::"
        "test_a_pot_stays_hollow_and_open_and_its_wall_is_whole",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/drawn_outline.py",
        "+ 2 * (rays * beyond).mean(1)",
        "+ 0 * (rays * beyond).mean(1)",
        "tests/voxels/cleanup/test_drawn_outline.py::test_a_disc_that_lies_elsewhere_than_told",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "owner[layers[layer], *places] = keeps.part",
        "owner[layers[layer], *places] = gives.part",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_the_wall_where_two_parts_overlap_is_of_one_below_and_of_the_other_above",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "last - first > NESTED * min",
        "last - first > 9 * min",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_a_narrow_part_or_one_within_another_is_made_in_all_its_layers",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "np.ptp(radii, axis=0)) > TOUCH",
        "np.ptp(radii, axis=0)) > 999",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_a_narrow_part_or_one_within_another_is_made_in_all_its_layers",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "upper.layers[shared[:split]] = False",
        "upper.layers[shared[:split]] = True",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_the_wall_where_two_parts_overlap_is_of_one_below_and_of_the_other_above",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "~(gives.strips & (away > end))",
        "True",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_a_handle_stays_where_the_wall_is_the_other_part_s",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/solids_of_revolution.py",
        "apart > COAXIAL",
        "apart > 999",
        "tests/voxels/cleanup/test_solids_of_revolution.py"
        "::test_parts_beside_each_other_are_made_in_all_their_layers",
    ),
    Mutant(
        "uniart_jax/data/mirror.py",
        "axis == 2, radii[..., ::-1], radii",
        "axis == 2, radii, radii",
        "tests/data/test_revolution_labels.py::test_rows_are_mirrored_as_their_objects_are",
    ),
    Mutant(
        "uniart_jax/training/revolution_loss.py",
        "round_ones = weights * (axis > 0)",
        "round_ones = weights",
        "tests/training/test_revolution_loss.py::"
        "test_an_outline_is_off_in_shares_of_half_its_box",
    ),
    Mutant(
        "uniart_jax/inference/samplers.py",
        "> THRESHOLD",
        "> 0.5",
        "tests/inference/test_samplers.py::"
        "test_found_layouts_are_the_parts_that_exist_the_surest_first",
    ),
    Mutant(
        "uniart_jax/data/geometric_features.py",
        "np.where(inside, -SDF_CLIP, SDF_CLIP)",
        "np.where(inside, SDF_CLIP, -SDF_CLIP)",
        "tests/data/test_geometric_features.py::test_height_and_thickness",
    ),
    Mutant(
        "uniart_jax/stages/train_network.py",
        'while self._read < state["read"]',
        "while False",
        "tests/stages/test_trainer.py::test_batches_of_ones_own_need_no_records_and_resume",
    ),
    Mutant(
        "uniart_jax/stages/train_network.py",
        "if source is not None and source.has(name):",
        "if source is not None:",
        "tests/stages/test_trainer.py::test_a_network_that_the_checkpoint_lacks_begins_from_scratch",
    ),
    Mutant(
        "uniart_jax/stages/trainer.py",
        "check_devices(config, chosen if batches is None else ())",
        "pass",
        f"{BEFORE}::test_devices_that_do_not_fit_are_told_before_data_is_made",
    ),
    Mutant(
        "uniart_jax/stages/trainer.py",
        "begun = bool(saved) or any(",
        "begun = True or any(",
        f"{BEFORE}::test_a_workdir_in_which_nothing_was_trained_may_hold_another_model",
    ),
    Mutant(
        "uniart_jax/pipeline.py",
        '**both | _known("structure", structure, alone["structure"])',
        '**_known("structure", structure, alone["structure"]) | both',
        "tests/test_pipeline_options.py::test_a_flow_has_options_of_its_own_before_those_of_both",
    ),
    Mutant("uniart_jax/training/step.py", "minimum(ema_decay,", "minimum(0.9,", DECAY),
    Mutant("uniart_jax/config/training.py", "= 0.9995", "= 0.9", DECAY),
    Mutant(
        "uniart_jax/training/flow_losses.py",
        "(latent - jnp.asarray(mean))",
        "(latent + jnp.asarray(mean))",
        "tests/training/test_losses.py::test_latents_are_brought_to_mean_0_and_deviation_1",
    ),
    Mutant(SAMPLERS, "x=found.x * std + mean)", "x=found.x * std - mean)", f"{UNITS}[structure]"),
    Mutant(SAMPLERS, "found.x * std + mean, 0)", "found.x * std - mean, 0)", f"{UNITS}[latent]"),
    Mutant(DINOV2, '"cubic", antialias=True', '"linear", antialias=True', POSITIONS),
    Mutant(DINOV2, '"cubic", antialias=True', '"cubic", antialias=False', f"{POSITIONS}[smaller]"),
    Mutant(
        DINOV2,
        '"cubic", antialias=True',
        '"linear", antialias=True',
        "tests/parity/test_parity.py::test_parity[dinov2_interp]",
    ),
    Mutant(
        "uniart_jax/evaluation/appearance.py",
        "[row[column] for row in rows]",
        "[row[column] for row in rows[1:]]",
        "tests/evaluation/test_psnr.py"
        "::test_articulated_figures_are_the_mean_of_five_states_and_rest_is_one_of_them",
    ),
    Mutant("uniart_jax/flow/guidance.py", "cond(inside(t).any(), ", "cond(t >= 0, ", INTERVAL),
    Mutant("uniart_jax/flow/guidance.py", "(t <= interval[1])", "(t <= 1)", INTERVAL),
    Mutant(
        "uniart_jax/models/flow_trunk.py",
        "else -out",
        "else out",
        "tests/inference/test_samplers.py::test_the_supplements_direction_is_the_mirror_image",
    ),
    Mutant(
        SAMPLERS,
        "guided = guide(velocity, condition, nothing, options.guidance, "
        "options.guidance_interval)\n        found = _solve(guided, noise, options, "
        "model.structure_flow)",
        "guided = guide(velocity, condition, nothing, options.guidance)\n        found = "
        "_solve(guided, noise, options, model.structure_flow)",
        f"{OUTSIDE}[structure]",
    ),
    Mutant(
        SAMPLERS,
        "guided = guide(velocity, condition, nothing, options.guidance, "
        "options.guidance_interval)\n        found = _solve(guided, noise, options, "
        "model.latent_flow, valid)",
        "guided = guide(velocity, condition, nothing, options.guidance)\n        found = "
        "_solve(guided, noise, options, model.latent_flow, valid)",
        f"{OUTSIDE}[latent]",
    ),
    Mutant(READ, "back, forth = forth, back", "pass", f"{KNOBS}_a_knob_turns_clockwise"),
    Mutant(
        BACKS,
        "(deep > 0) & (deep < THICK)",
        "True",
        f"{OF_BACKS}_each_part_goes_by_its_own_front_and_what_is_far_behind_stays",
    ),
    Mutant(BACKS, "(edge > SURE)", "True", f"{OF_BACKS}_guesses_beside_an_edge_do_not_count"),
    Mutant(READ, "turn.direction < 0", "turn.direction > 0", f"{KNOBS}_a_knob_turns_clockwise"),
    Mutant(READ, "> OFF_AXIS * largest", "> 9", f"{KNOBS}_a_small_lid_opens_as_it_is_read"),
    Mutant(
        "uniart_jax/voxels/cleanup/column_maps.py",
        "PARTLY = (0.2, 0.8)",
        "PARTLY = (-9.0, 9.0)",
        "tests/voxels/cleanup/test_column_maps.py::test_raised_panels_are_not_round",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/fronts.py",
        "if covered.mean() >= SHUT else None",
        "",
        "tests/voxels/cleanup/test_rooms.py"
        "::test_a_frame_around_a_pane_shuts_a_room_and_a_bail_does_not[0-False]",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/rooms.py",
        "min(near, far) - middle > BENT",
        "False",
        "tests/voxels/cleanup/test_rooms.py::test_a_round_vessel_under_a_lid_stays_round[0.0]",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/align_open_parts.py",
        "(at_rim > cells / 2)",
        "(at_rim < 0)",
        "tests/voxels/cleanup/test_align_open_parts.py"
        "::test_what_stands_out_at_a_panels_rim_or_is_small_is_no_handle",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/flat_faces.py",
        "if phi is not drawn:",
        "if False:",
        "tests/voxels/cleanup/test_flat_doors.py"
        "::test_the_edges_of_a_closed_door_do_not_reach_to_its_handle",
    ),
    Mutant(SESSIONS, "session.uploads - held", "session.uploads", SHARED),
    Mutant(SESSIONS, "if not file.is_relative_to(self.root) or", "if", TAKEN),
    Mutant(NAP, "np.cross(direction, moment)", "np.cross(moment, direction)", f"{MOVES}[1.0-0.0]"),
    Mutant(EXPORT_NAP, "line if edge[\"src\"] == parent else -line", "line", f"{MOVES}[1.0-0.0]"),
    Mutant(
        FRAMES,
        "if free[row:].all() if step > 0 else free[:row].all():",
        "if False:",
        "tests/voxels/cleanup/test_flat_frames.py::test_what_is_open_below_stays_open",
    ),
    Mutant(
        FRAMES,
        "rubble |= piece & ((np.abs(depths - usual) < NEAR).mean() < MOST)",
        "rubble |= piece",
        "tests/voxels/cleanup/test_flat_frames.py"
        "::test_rubble_is_brought_forward_and_a_niche_with_a_ground_is_not",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/room_to_move.py",
        "    much = (lines > 0).sum(0) > LINE * len(lines)\n",
        "    much = (lines > 0).sum(0) > len(lines)\n",
        "tests/voxels/cleanup/test_room_to_move.py"
        "::test_what_is_cut_along_a_hinge_is_straight",
    ),
    Mutant(
        PROGRAM_CACHE,
        "path = _path(_folder, \".program\", tree, shapes, kind, settings)",
        "path = _path(_folder, \".program\", tree, kind, settings)",
        "tests/runtime/test_program_cache.py"
        "::test_what_a_trace_depends_on_makes_another_program[shapes]",
    ),
    Mutant(
        PROGRAM_CACHE,
        "len(jax.devices()) > 1 or",
        "",
        "tests/runtime/test_program_cache.py::test_several_devices_keep_nothing",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "WIDE = 100",
        "WIDE = 24",
        "tests/export/test_picture_colors.py"
        "::test_a_patch_goes_but_for_windows_of_what_moves",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        'moves = obj.parts[int(k)].joint.type != "fixed"',
        "moves = False",
        "tests/export/test_picture_colors.py::test_a_patch_goes_but_for_windows_of_what_moves",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/flat_faces.py",
        " or (sharp < SHARP and maps.tilted(near, around))",
        "",
        "tests/voxels/cleanup/test_flat_faces.py::test_a_tilted_face_stays_tilted",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/flat_faces.py",
        "SHARP, BARELY = 0.6, 0.55",
        "SHARP, BARELY = 0.6, 0.6",
        "tests/voxels/cleanup/test_flat_faces.py::test_a_wall_in_two_depths_becomes_one",
    ),
    Mutant(
        "uniart_jax/export/picture_colors.py",
        "            filled[hidden] = decoded(hidden)\n",
        "",
        "tests/export/test_picture_colors.py"
        "::test_hidden_places_of_which_none_is_asked_have_the_networks_colours",
    ),
    Mutant(
        "uniart_jax/objects/facing.py",
        "FRONTS.index(front))",
        "-FRONTS.index(front))",
        "tests/evaluation/test_peers.py::test_every_front_comes_to_minus_x[+y-turned3]",
    ),
    Mutant(
        "uniart_jax/inference/layouts.py",
        "turned = np.where(differ, share > 0.5, share)",
        "turned = share",
        "tests/inference/test_layout_predictor.py"
        "::test_joints_that_differ_are_not_averaged[1.0-True]",
    ),
    Mutant(
        "uniart_jax/voxels/front_lines.py",
        "half = np.clip(gap, *GAP) / 2",
        "half = gap / 2",
        "tests/voxels/test_front_lines.py"
        "::test_drawers_of_a_grid_have_common_edges_and_even_gaps[0]",
    ),
    Mutant(
        "uniart_jax/voxels/front_lines.py",
        "boards[part] = _boards_of(boards[part], old, boxes[part])",
        "pass",
        "tests/voxels/test_front_lines.py::test_a_hinge_and_boards_go_with_their_door",
    ),
    Mutant(
        "uniart_jax/data/layout_batches.py",
        "parts_of(batch) if draw.number % data.box_sets_every else batch",
        "batch",
        "tests/data/test_layout_batches.py"
        "::test_one_batch_of_several_has_legs_panels_and_boards",
    ),
    Mutant(
        "uniart_jax/voxels/front_lines.py",
        "if not (shared > COVERED).all(1).any():",
        "if True:",
        "tests/voxels/test_front_lines.py::test_what_is_behind_a_front_is_none",
    ),
    Mutant(
        "uniart_jax/training/step.py",
        "mask = frozen_mask(state.params, (*freeze, *idle(micro)))",
        "mask = frozen_mask(state.params, freeze)",
        "tests/training/test_state.py::test_momentum_does_not_move_what_a_batch_does_not_read[2.0]",
    ),
    Mutant(
        "uniart_jax/models/layout.py",
        "_proportions(corners).astype(y.dtype)",
        "0 * _proportions(corners).astype(y.dtype)",
        "tests/models/test_revolution_head.py::test_it_sees_how_long_a_box_is",
    ),
    Mutant(
        "uniart_jax/voxels/typed_batches.py",
        'name for name in LayoutBatch._field_defaults if name != "revolutions"',
        "name for name in LayoutBatch._field_defaults",
        "tests/models/test_revolution_head.py"
        "::test_it_is_trained_by_batches_without_legs_panels_and_boards",
    ),
    Mutant(
        "uniart_jax/export/budget.py",
        "free[k][i] &= not np.min(sides) > least",
        "free[k][i] &= True",
        "tests/export/test_protrusions.py::test_what_is_in_the_way_of_another_part_goes",
    ),
    Mutant(
        "uniart_jax/export/budget.py",
        "most = max(min(budget // 2, budget - len(standing)), 0)",
        "most = budget // 2",
        "tests/export/test_protrusions.py::test_handles_leave_a_shape_for_every_part",
    ),
    Mutant(
        "uniart_jax/data/layout_renders.py",
        "further(corners[face], body[face] + out)",
        "corners[face]",
        "tests/data/test_layout_renders.py::test_a_drawer_whose_front_lies_in_the_bodys_is_seen",
    ),
    Mutant(
        "uniart_jax/data/layout_renders.py",
        "min(TOP, box[5])",
        "0",
        "tests/data/test_layout_renders.py::test_legs_that_reach_the_top_leave_a_top",
    ),
    Mutant(
        "uniart_jax/voxels/usual_boards.py",
        "ends[away.argmax()] - ends[away.argmin()]",
        "joint.travel[1]",
        "tests/voxels/test_usual_boards.py"
        "::test_a_drawer_is_open_above_and_has_its_front_where_it_opens",
    ),
    Mutant(
        "uniart_jax/voxels/panel_table.py",
        "(self.boxes - np.tile(middle, 2)) / side",
        "self.boxes / side",
        "tests/voxels/test_layout_json.py::test_a_layout_in_metres_becomes_one_in_object_units",
    ),
    Mutant(
        "uniart_jax/pipeline.py",
        "side = longest if layout.metres else layout.size",
        "side = None",
        "tests/test_pipeline.py::test_an_object_of_a_layout_in_metres_has_its_size",
    ),
    Mutant(
        "uniart_jax/export/box_growth.py",
        "np.int64(-filled.size)",
        "np.int64(0)",
        "tests/export/test_box_growth.py::test_one_cell_that_is_not_allowed_stops_a_layer",
    ),
    Mutant(
        "uniart_jax/export/box_growth.py",
        "int(shut[below - 1]) + 1 if below else 0",
        "low[axis]",
        "tests/export/test_box_growth.py::test_a_box_grows_as_far_as_every_layer_allows",
    ),
    Mutant(
        "uniart_jax/export/preview.py",
        "np.arctan2(code[0], code[1])",
        "np.arctan2(code[1], code[0])",
        "tests/export/test_preview.py::test_a_known_camera_is_the_view",
    ),
    Mutant(
        "uniart_jax/export/protrusions.py",
        "self.visible & (far >= reach)",
        "self.visible",
        "tests/export/test_protrusions.py::test_near_a_hinge_there_is_no_handle",
    ),
    Mutant(
        "uniart_jax/export/protrusions.py",
        "inside=self.inside & ~here",
        "inside=self.inside",
        "tests/export/test_protrusions.py::test_what_was_carved_away_does_not_come_back",
    ),
    Mutant(
        "uniart_jax/export/handles.py",
        "out &= _radii(obj, k, centers) >= FROM_HINGE * far",
        "out &= True",
        "tests/export/test_handles.py::test_what_stands_out_beside_the_hinge_is_no_handle",
    ),
    Mutant(
        "uniart_jax/export/part_kinds.py",
        'return "rack" if any(_before(boxes[j], box) for j in plates) else "drawer"',
        'return "drawer"',
        "tests/export/test_part_kinds.py::test_a_rack_is_behind_a_door_and_a_handle_before_one",
    ),
    Mutant(
        "uniart_jax/export/size.py",
        "boxes = bounds_at(obj, obj.rest())",
        "boxes = obj.bounds[None]",
        "tests/export/test_size.py::test_as_long_at_rest_as_usual",
    ),
    Mutant(
        "uniart_jax/inference/camera_fit.py",
        "FAR_VIEW * (1 - toward @ _toward(x[0], x[1]))",
        "0.0",
        "tests/inference/test_camera_fit.py"
        "::test_a_guess_decides_where_outlines_agree_from_several_sides",
    ),
    Mutant(
        "uniart_jax/inference/camera_fit.py",
        "return 1 - overlap + far",
        "return far",
        "tests/inference/test_camera_fit.py::test_the_camera_of_an_outline_is_found",
    ),
    Mutant(
        "uniart_jax/inference/answers.py",
        "size=side if told.metres else told.size",
        "size=told.size",
        "tests/inference/test_answers.py"
        "::test_an_answer_is_a_layout_in_object_units_as_the_picture_shows_it_and_a_view",
    ),
    Mutant(
        "uniart_jax/inference/ask_layout.py",
        "azimuth - share * apart",
        "azimuth + share * apart",
        "tests/inference/test_ask_layout.py"
        "::test_the_guess_is_a_mean_unless_network_and_model_are_far_apart",
    ),
    Mutant(
        "uniart_jax/voxels/shown_state.py",
        "motion(parents[k]) @ joints[k].motion(shown[k])",
        "joints[k].motion(shown[k])",
        "tests/voxels/test_shown_state.py"
        "::test_points_of_a_part_are_where_its_motion_and_its_parents_take_them",
    ),
    Mutant(
        "uniart_jax/voxels/tube_table.py",
        "np.clip((places - start) @ along / length, 0, 1)",
        "((places - start) @ along / length)",
        "tests/voxels/test_tube_table.py::test_distances_are_those_of_capsules",
    ),
    Mutant(
        "uniart_jax/voxels/cleanup/told_shapes.py",
        "where = ~stays & (whose >= 0)",
        "where = whose >= 0",
        "tests/voxels/cleanup/test_told_shapes.py::test_a_part_that_moves_is_not_written_over",
    ),
    Mutant(
        "uniart_jax/evaluation/layout.py",
        "return carrier(parents[k]) if k in fixed else k",
        "return k",
        "tests/evaluation/test_layout_metrics.py::test_layouts_in_metres_and_rows_that_are_fixed_"
        "are_judged_as_objects_have_them",
    ),
    Mutant(
        "uniart_jax/voxels/shown_state.py",
        "return dataclasses.replace(own, motion=motion)",
        "return own",
        "tests/voxels/test_shown_state.py::test_a_lever_that_is_shown_turned_is_drawn_where_it_is",
    ),
    Mutant(
        "uniart_jax/voxels/follow.py",
        "fixed and place[up] < shown",
        "False",
        "tests/voxels/test_follow.py"
        "::test_a_row_that_is_fixed_and_told_is_a_piece_of_what_carries_it",
    ),
)  # fmt: skip
