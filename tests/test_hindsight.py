"""The actions in which `scripts/hindsight.py` learns can do what it is to learn."""

from project_scripts import load_script


def test_a_few_lines_solve_place_in_steps_of_palm_and_closing():
    hindsight = load_script("hindsight")
    env = hindsight.Macro("tomato_soup_can", 2, hindsight.WHOLE)
    rows = hindsight.judge(env, hindsight.by_hand(env), [{}] * 2, 500)
    assert [row["solved"] for row in rows] == [True, True]
    assert hindsight.rates(rows)["all"]["n"] == 2
