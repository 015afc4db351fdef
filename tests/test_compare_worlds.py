"""Two worlds of objects held beside each other: ``tools/compare_worlds.py``."""

import compare_worlds as worlds
import numpy as np

from uniart_jax import procedural


def test_roles_and_places_of_a_washer():
    names = []
    for seed in range(6):
        obj = procedural.generate("washer", seed)
        for part in obj.parts[1:]:
            names.append((part.label, worlds.role(part)))
    expected = {"door": "door", "lid": "lid", "drum": None, "detergent_drawer": "drawer"}
    for label, found in names:
        if expected.get(label):
            assert found == expected[label]
    values = worlds.object_values(procedural.generate("refrigerator", 3))
    assert values["object: moving parts"] == [
        values["door: an object"][0] + values["drawer: an object"][0]
    ]
    assert all(0 <= v <= 1 for v in values["door: bottom above floor"])
    moved = procedural.generate("refrigerator", 3)
    opened = moved.shown_at(np.where(moved.limits[:, 1] > 0, moved.limits[:, 1] / 2, 0))
    again = worlds.object_values(opened)  # measured at rest, whatever is shown
    np.testing.assert_allclose(again["door: width (y)"], values["door: width (y)"], atol=1e-6)


def test_comparison_finds_what_is_outside_and_what_fits():
    made = [procedural.generate("microwave", seed) for seed in range(12)]
    values = [worlds.object_values(o) for o in made]
    same = worlds.compare(values, values)
    assert min(row["inside"] for row in same) > 0.5
    wide = [{"object: width / height": [50.0]} for _ in range(4)]
    assert worlds.compare(wide, values)[0]["inside"] == 0
    assert "| object: width / height | 4 |" in worlds.table(worlds.compare(wide, values))
    rests = [worlds.at_rest(o) for o in made]
    good, number, index = worlds.nearest(rests[3], rests)
    assert good == number > 0 and worlds.nearest(rests[index], rests[index : index + 1])[0] == good
    far = (rests[3][0] + np.array([0.5, 0, 0, 0, 0, 0]), *rests[3][1:])
    assert worlds.nearest(far, rests[3:4])[0] == 0
