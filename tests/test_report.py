"""The report: one self-contained page for every verdict, with the numbers of the diagnosis and nothing unescaped."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from diagnosis import figures
from diagnosis.command_steps import COMMAND_STEPS, CommandSteps
from diagnosis.encoder_waves import READINGS, Wave
from diagnosis.figures import equation, report_style, residual_spectrum
from diagnosis.ledger import closed, simulated
from diagnosis.model_equations import model_equations
from diagnosis.output import to_json
from diagnosis.patchwork import Patchwork
from diagnosis.problem import DIVERGED
from diagnosis.quantities import measured, number, percent, plain, quantity, unbroken
from diagnosis.remainder import Drift
from diagnosis.report import HELPED, MEANING, UNCERTAIN, adequacy, render
from diagnosis.result import (
    Alternative,
    Diagnosis,
    Estimate,
    Evidence,
    Gap,
    Isolability,
    JointResult,
    LedgerRow,
    NamedEffect,
    NextExperiment,
    NominalParameter,
    ParameterEstimate,
    PartialResidual,
    Provenance,
    Quantiles,
    Series,
    SignalDependence,
    Spectrum,
)
from diagnosis.text import describe, enumerated, gain, joint_sentence, parameter_title, table
from methods.effects import built_in

ROOT = Path(__file__).resolve().parents[1]
HOSTILE = '<script>alert("1")</script> $x_{ & \' "onmouseover="x'
VERDICTS = tuple(MEANING)


def series(log: str, held_out: bool) -> Series:
    time = np.linspace(0.0, 10.0, 801)
    velocity = np.cos(3 * time)
    friction = -0.05 * np.sign(velocity)
    free = 0.04 * np.sin(2 * time) if held_out else np.full(time.shape, np.nan)
    return Series(
        log=log,
        held_out=held_out,
        time=time,
        command=np.sin(3 * time),
        reading=np.sin(3 * time) / 3,
        velocity=velocity,
        acceleration=-3 * np.sin(3 * time),
        motor_torque=np.sin(3 * time) - 0.3 * velocity,
        before=friction,
        after=0.01 * friction,
        free_before=free,
        free_after=0.05 * free,
    )


def friction(joint: int, rivals: tuple[str, ...] = ()) -> NamedEffect:
    effect = next(e for e in built_in() if e.name == "coulomb_friction")
    return NamedEffect(
        name=effect.name,
        joint=joint,
        stage=effect.stage,
        equation=effect.equation,
        variable=effect.variable,
        parameters=(ParameterEstimate("torque", Estimate(6.912, 0.118, "N m"), Estimate(0.0549, 0.00094, "V")),),
        evidence=Evidence(5321.0, 11.0, 0.05),
        alternatives=tuple(Alternative(name, joint, Evidence(5320.0, 22.0)) for name in rivals),
    )


def law(effect: str | None) -> PartialResidual:
    x = np.linspace(-1.0, 1.0, 40)
    step = 0.05 * np.sign(x)
    noise = Quantiles(0.0 * x, 0.0 * x - 0.002, 0.0 * x + 0.002)
    return PartialResidual(
        effect=effect,
        kind="resistance",
        signal="velocity",
        signal_unit="rad/s",
        unit="V",
        x=x,
        before=Quantiles(step, step - 0.002, step + 0.002),
        after=noise,
        laws=((effect, step), ("dead_zone", 0.9 * step)) if effect else (),
        samples=np.stack([x, step]),
        continuous=False,
    )


def nominal(
    name: str, unit: str, given: float | None, without: tuple[float, float], final: tuple[float, float]
) -> NominalParameter:
    return NominalParameter(name, unit, given, Estimate(*without, unit), Estimate(*final, unit))


def joint_result(joint: int, verdict: str, log: str) -> JointResult:
    effects = {
        "none": (),
        "named": (friction(joint),),
        "ambiguous": (friction(joint, ("dead_zone",)),),
        "unknown": (friction(joint),),
    }[verdict]
    left = verdict == "unknown"
    return JointResult(
        joint=joint,
        input="voltage",
        command_unit="V",
        position_unit="rad",
        torque_unit="N m",
        input_equivalent=0.00794,
        verdict=verdict,
        effects=effects,
        nominal=(
            nominal("inertia", "V s^2/rad", 0.075, (0.07, 1e-4), (0.0681, 2e-5)),
            nominal("damping", "V s/rad", None, (0.8, 1e-2), (0.53, 0.05)),
            nominal("electrical_time_constant", "s", 0.01, (0.007, 1e-4), (0.008, 1e-5)),
        ),
        remainder=(
            SignalDependence("position", 420.0 if left else 9.0, 8, 1e-80 if left else 1.0),
            SignalDependence("elapsed time", 5.0, 8, 1.0),
        ),
        remainder_excess=380.0 if left else 0.0,
        series=(series(log, held_out=False), series("check", held_out=True)),
        spectrum=Spectrum(np.linspace(0, 40, 200), np.full(200, 0.01), np.full(200, 0.001)),
        isolability=(
            Isolability("coulomb_friction", joint, 0.0002, 0.0003, "stribeck_friction", 4.2),
            Isolability("axis_coupling", joint, None, None, None, None),
        ),
        partial_residuals=(*(law(effect.name) for effect in effects), law(None)),
    )


def example(verdict: str, joints: int = 1, log: str = "train") -> Diagnosis:
    """A diagnosis as `diagnosis.run` gives it, with invented numbers."""
    results = tuple(joint_result(joint, verdict, log) for joint in range(1, joints + 1))
    floor = 0.03 if verdict == "none" else 0.00101  # a model that lacks nothing errs by little more than noise
    gaps = tuple(Gap(r.joint, "rad", 0.04123, 0.00312, floor, 0.9475, (0.93, 0.96), "held-out") for r in results)
    ledger = tuple(
        LedgerRow(r.joint, step, role, 0.05, error, 2 * error, (0.9 * error, 1.1 * error), share, 1.3)
        for r in results
        for step, role, error, share in (
            ("nominal as given", "as given", 0.0501, -0.2),
            ("refit nominal parameters", "nominal", 0.04123, 0.0),
            ("+ coulomb_friction", "effect", 0.00312, 0.9475),
            ("least squares and network", "rival", 0.0102, 0.77),
        )
    )
    size = {"name": log, "source": log, "sha256": "ab" * 32, "samples": 801, "duration": 10.0, "sample_time": 0.0125}
    return Diagnosis(
        verdict=verdict,
        sentence=" ".join(joint_sentence(r, g) for r, g in zip(results, gaps, strict=True)),
        joints=results,
        gaps=gaps,
        ledger=ledger,
        next_experiment=NextExperiment(1, "multisine:amplitude=2", "sharpen the torque", "half the deviation", 2.0),
        provenance=Provenance(
            (size,),
            (),
            "AdeptOne",
            "2f" * 32,
            {"map.toml": "7c" * 32},
            {"python": "3.11"},
            {"threshold": 12.0},
            {"search": 3.2},
            findings=(log,),
        ),
    )


class Page(HTMLParser):
    """Tags, attributes, ids and visible text of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] != ["style"]:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def test_the_page_says_why_whole_logs_err_by_far_more_than_windows() -> None:
    diagnosis = example("named")
    adrift = tuple(replace(row, whole_error=30.0 * (row.window_error or 0.0)) for row in diagnosis.ledger)
    assert "drifts" not in Page(render(diagnosis)).text
    assert "a joint that nothing pulls back drifts" in Page(render(replace(diagnosis, ledger=adrift))).text


def test_a_joint_that_errs_by_what_the_other_one_of_a_pair_lacks_is_not_called_good() -> None:
    diagnosis = example("none", joints=2)
    first = replace(diagnosis.joints[0], beside=2)
    said = joint_sentence(first, diagnosis.gaps[0])
    assert "nothing of its own is missing; adding what is named at joint 2 cuts the held-out error from 41.2" in said
    shown = Page(render(replace(diagnosis, joints=(first, diagnosis.joints[1])))).text
    assert HELPED in shown
    assert shown.count("of the explainable gap closed") == 1
    for share, after in ((0.0, 0.04123), (None, 0.04)):  # it is as good without
        same = replace(diagnosis.gaps[0], closed=share, after=after, noise_floor=0.04)
        assert "is good to the noise floor" in joint_sentence(first, same)


def test_a_gain_that_effects_at_the_other_joint_of_a_pair_share_is_said_to_be_theirs_too() -> None:
    diagnosis = example("named", joints=2)
    alone, shared = (
        joint_sentence(replace(diagnosis.joints[0], beside=other), diagnosis.gaps[0]) for other in (None, 2)
    )
    assert "missing; adding it cuts the held-out error from 41.2" in alone
    assert "missing; adding it, with what is named at joint 2, cuts the held-out error from 41.2" in shared


@pytest.mark.parametrize("least", [0.15, 1.5])
def test_a_spectrum_of_few_powers_of_ten_has_short_labels_on_its_axis(
    least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "svg", lambda figure, *given: figure)
    density = np.geomspace(least, 7.0, 100)
    figure = residual_spectrum(Spectrum(np.arange(100.0), density, 0.9 * density), "V", "spectrum")
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels(which="both") if text.get_text()]  # type: ignore[attr-defined]
    assert {"2", "5"} <= set(labels)
    assert max(map(len, labels)) < 5


@pytest.mark.parametrize(("floor", "is_good"), [(0.03, True), (0.00101, False)])
def test_what_errs_by_far_more_than_the_noise_floor_is_not_called_good_to_it(floor: float, is_good: bool) -> None:
    diagnosis = example("none")
    gap = replace(diagnosis.gaps[0], after=0.04123, noise_floor=floor)
    said, shown = joint_sentence(diagnosis.joints[0], gap), Page(render(replace(diagnosis, gaps=(gap,)))).text
    assert ("is good to the noise floor" in said) is is_good
    assert ("no known effect is missing; the held-out error is 41.2 mrad, noise floor 1.01 mrad" in said) is not is_good
    assert (MEANING["none"] in shown) is is_good
    assert (UNCERTAIN in shown) is not is_good


def test_long_names_in_the_waterfall_are_not_clipped(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "svg", lambda figure, name, label: drawn.append(figure))
    diagnosis = example("named")
    row = replace(diagnosis.ledger[2], step="+ torque_constant_saturation at joint 2")
    with report_style():
        figures.waterfall([*diagnosis.ledger[:2], row], diagnosis.gaps[0], "long")
    FigureCanvasAgg(drawn[0]).draw()
    labels = drawn[0].axes[0].get_yticklabels()
    assert labels[-1].get_text() == "+ torque constant saturation at joint 2"
    assert min(label.get_window_extent().x0 for label in labels) >= 0.0


def test_long_names_in_the_ranking_are_not_clipped(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(figures, "svg", lambda figure, name, label: drawn.append(figure))
    names = sorted({effect.label for effect in built_in()}, key=len)[-2:]
    considered = [Alternative(name, joint, Evidence(50.0, 10.0)) for name in names for joint in (1, 12)]
    with report_style():
        figures.ranking(considered, names[0], (), 12.0, "long")
    FigureCanvasAgg(drawn[0]).draw()
    labels = drawn[0].axes[0].get_yticklabels()
    assert labels[-1].get_text() == f"{names[-1].replace('_', ' ')} (12)"
    assert min(label.get_window_extent().x0 for label in labels) >= 0.0


def test_a_shift_is_no_share_of_a_whole() -> None:
    diagnosis = example("named")
    doubled = nominal("damping", "V s/rad", None, (1.99997, 1e-3), (1.0, 1e-3))
    joint = replace(diagnosis.joints[0], nominal=(doubled,))
    assert "+100\u00a0%" in render(replace(diagnosis, joints=(joint,)))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_is_a_readable_page(verdict: str) -> None:
    diagnosis = example(verdict)
    page = Page(render(diagnosis))
    assert MEANING[verdict] in page.text
    assert " ".join(diagnosis.sentence.split()) in page.text
    for heading in ("The gap", "What the logs show", "Ledger", "What stays unexplained", "The next experiment"):
        assert heading in page.text
    sure = diagnosis.verdict != "unknown"
    assert ("The cause" in page.text) == (bool(diagnosis.effects) and sure)
    assert ("What explains a part of it" in page.text) == (bool(diagnosis.effects) and not sure)
    assert ("the noise floor is that of the encoder alone" in page.text) == (bool(diagnosis.joints) and not sure)
    assert "None" not in page.text
    assert not re.search(r"\bnan\b", page.text)


def test_a_proposed_experiment_has_its_unit_and_the_place_where_it_is_explained() -> None:
    diagnosis = example("ambiguous")
    assert diagnosis.next_experiment is not None
    part = Page(render(diagnosis)).text.split("The next experiment")[1]
    assert diagnosis.next_experiment.excitation in part
    assert f"amplitude and offset in {diagnosis.joints[0].command_unit}, times in s, bands in Hz" in part
    [page] = re.findall(r"docs/\w+\.md", part)
    assert "A proposed experiment" in (ROOT / page).read_text(encoding="utf-8")


def test_the_page_fetches_nothing() -> None:
    text = render(example("named", joints=2))
    page = Page(text)
    assert "http" not in text
    assert not {"script", "link", "img", "iframe", "object"} & set(page.tags)
    for name, value in page.attributes:
        if name.endswith(("href", "src")):
            assert value.startswith("#")
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_ids_are_unique_and_targets_exist() -> None:
    page = Page(render(example("ambiguous", joints=3)))
    ids = [value for name, value in page.attributes if name == "id"]
    targets = {value[1:] for name, value in page.attributes if name.endswith("href")}
    assert len(ids) == len(set(ids))
    assert targets <= set(ids)
    assert {"joint-1", "joint-2", "joint-3"} <= set(ids)


def test_joints_of_a_described_robot_have_their_names() -> None:
    full = example("named", joints=2)
    titled = replace(full, joints=(full.joints[0], replace(full.joints[1], title="shoulder_lift")))
    assert Page(render(titled)).text.count("shoulder_lift") == 2  # in the table and above its section
    assert "shoulder_lift" not in Page(render(full)).text


def test_what_was_noticed_stands_in_the_terminal() -> None:
    diagnosis = example("named")
    (found,) = diagnosis.provenance.findings
    assert f"Noted: {found[:40]}" in table(diagnosis, width=400)


def test_an_alternative_at_another_joint_is_said_with_it() -> None:
    full = example("named", joints=2)
    rivals = tuple(Alternative("stribeck_friction", joint, Evidence(5320.0, 22.0)) for joint in (1, 2))
    first = full.joints[0]
    effects = (replace(first.effects[0], alternatives=rivals),)
    text = table(replace(full, joints=(replace(first, effects=effects), *full.joints[1:])), width=400)
    assert "stribeck_friction, stribeck_friction at joint 2" in text


def test_the_page_says_what_noise_alone_explains_where_small_causes_grow() -> None:
    diagnosis = example("named")
    rough = replace(diagnosis, joints=tuple(replace(joint, scattered=445.0) for joint in diagnosis.joints))
    assert "noise alone would lower −2 log likelihood by about 445" in Page(render(rough)).text
    assert "Small causes grow" not in Page(render(diagnosis)).text


def test_numbers_of_the_sentence_are_those_of_the_json() -> None:
    diagnosis = example("named")
    data = json.loads(to_json(diagnosis))
    found = re.search(
        r"Coulomb friction of ([\d.]+) ± ([\d.]+) N m is missing; adding it cuts the held-out error "
        r"from ([\d.]+) to ([\d.]+) mrad, noise floor ([\d.]+) mrad",
        Page(render(diagnosis)).text,
    )
    assert found is not None
    torque = data["effects"][0]["parameters"]["torque"]
    for shown, value in zip(
        found.groups(),
        (torque["value"], torque["std"], *(1e3 * data["gap"][key] for key in ("before", "after", "noise_floor"))),
        strict=True,
    ):
        decimals = len(shown.partition(".")[2])
        assert float(shown) == pytest.approx(value, abs=0.51 * 10.0**-decimals)
    assert data["sentence"] == diagnosis.sentence


def test_the_sentence_of_an_unknown_cause_says_whether_other_logs_gain() -> None:
    result = joint_result(1, "unknown", "train")
    gap = Gap(1, "rad", 0.04123, 0.00312, 0.00101, 0.9475, (0.93, 0.96), "held-out")
    helps = "explains part of the gap (adding it cuts the held-out error from 41.2 to 3.12 mrad, noise floor 1.01 mrad)"
    assert f"{helps}, but something is missing" in joint_sentence(result, gap)
    worse = "fits these logs better but not others (adding it changes the held-out error from 41.2 to 50.0 mrad"
    assert worse in joint_sentence(result, replace(gap, after=0.05, closed=-0.2))
    same = gain(replace(gap, before=0.0029, after=0.0029))
    assert same == "leaves the held-out error at 2.90 mrad, noise floor 1.01 mrad"
    little = joint_sentence(result, replace(gap, after=0.035, closed=0.17))
    assert little.startswith("Joint 1: something is missing that no known effect explains")
    assert "; Coulomb friction of 6.91 ± 0.12 N m explains part of the gap (adding it" in little


def test_an_effect_of_unknown_strength_is_only_named_and_an_event_of_one_log_dated() -> None:
    def effect(name: str, strength: tuple[float, float], **others: object) -> NamedEffect:
        own = {"torque": Estimate(*strength, "N m"), "time": Estimate(6.3699, 1e-4, "s")}
        parameters = tuple(ParameterEstimate(key, found, found) for key, found in own.items())
        return replace(friction(1), name=name, parameters=parameters, **others)

    assert describe(effect("cogging_torque", (1e3, 2.6e4))) == "cogging torque"
    assert plain(describe(effect("cogging_torque", (3.2, 0.1)))) == "cogging torque of 3.20 ± 0.10 N m"
    dated = effect("collision", (1.667, 0.01), only_in="fit2")
    assert plain(describe(dated)) == "collision of 1.667 ± 0.010 N m at 6.37 s in fit2"
    assert plain(describe(replace(dated, only_in=None))) == "collision of 1.667 ± 0.010 N m"


def test_the_sentence_names_the_parameters_that_drift_where_only_time_tells() -> None:
    time_alone = (SignalDependence("elapsed time", 900.0, 8, 0.0),)
    drifts = tuple(
        Drift(name, decrease, 4, 0.0, 0.05)
        for name, decrease in (("viscous@0", 601.0), ("inertia@0", 598.0), ("back_emf@0", 580.0))
    )
    joint = replace(joint_result(1, "unknown", "train"), effects=(), remainder=time_alone, drifts=drifts)
    either = "; it depends on elapsed time: the viscous damping or the inertia does not stay the same over the logs."
    assert joint_sentence(joint, None).endswith(either)
    assert joint_sentence(replace(joint, drifts=()), None).endswith("; it depends on elapsed time.")
    position = (SignalDependence("position", 950.0, 8, 0.0), *time_alone)
    assert joint_sentence(replace(joint, remainder=position), None).endswith(
        "; it depends on position and elapsed time."
    )
    direction = replace(joint, remainder=(SignalDependence("direction", 950.0, 5, 0.0),))
    assert "direction by position (as friction that differs along the travel does)" in joint_sentence(direction, None)
    only = joint_sentence(replace(joint, remainder=(), drifts=drifts[:1]), None)
    assert only.endswith("; the viscous damping does not stay the same over the logs.")


def test_a_torque_that_grows_with_the_heat_has_one_sign() -> None:
    rise = ParameterEstimate("resistance_rise", *2 * [Estimate(-0.23, 0.14, "1")])
    said = plain(describe(replace(friction(1), name="thermal_drift", parameters=(rise,)), "A"))
    assert said == "thermal drift to 1/(1 − 0.23 ± 0.14) of the cold torque"


def test_the_sentence_says_how_the_readings_err() -> None:
    result = replace(joint_result(1, "unknown", "train"), wave=Wave(256.2, 8.8e-4, 0.5))
    assert "the readings themselves err by 880 µrad, 256.2 times per revolution" in joint_sentence(result, None)


def test_what_smooth_torques_do_not_explain_has_a_sentence_of_its_own() -> None:
    steps, readings = SignalDependence(COMMAND_STEPS, 900.0, 6, 0.0), SignalDependence(READINGS, 700.0, 16, 0.0)
    plain_one = replace(joint_result(1, "unknown", "train"), effects=(), remainder_excess=0.0)
    coarse = replace(plain_one, remainder=(steps,), coarse=CommandSteps(0.0524, 900.0, 6, 262))
    assert joint_sentence(coarse, None).endswith("the amplifier rounds its command to steps of 52.4 mV.")
    misread = replace(plain_one, remainder=(readings,))
    assert joint_sentence(misread, None).endswith("the readings themselves err over the position.")
    for joint, said, other in (
        (coarse, "steps of the command 52.4 mV wide", "The readings themselves err"),
        (misread, "The readings themselves err over the position", "steps of the command"),
    ):
        diagnosis = replace(example("unknown"), joints=(joint,))
        page = plain(render(diagnosis))
        assert said in page
        assert other not in page
        assert "Only traces" not in page
        found = json.loads(to_json(diagnosis))["remainder"]["command_steps"]
        assert [item["width"] for item in found] == ([0.0524] if joint is coarse else [])


def test_the_sentence_of_a_patchwork_says_what_the_names_stand_for() -> None:
    one = replace(joint_result(1, "unknown", "train"), patched=Patchwork.FRICTION)
    part = "describes the logs, but only as part of one law of friction that no known effect is"
    assert part in joint_sentence(one, None)
    two = replace(one, effects=one.effects * 2, patched=Patchwork.POSITION)
    pieces = "describe the logs, but only as pieces of one smooth torque of the position that no known effect is"
    assert pieces in joint_sentence(two, None)


def test_a_law_is_as_strong_as_all_its_levels_say() -> None:
    levels = tuple(
        ParameterEstimate(name, Estimate(value, 0.1, "N m"), Estimate(0.008 * value, 0.0008, "V"))
        for name, value in (("torque", 6.9), ("static_torque", 8.4), ("velocity", 0.02))
    )
    assert plain(describe(friction(1))) == "Coulomb friction of 6.91 ± 0.12 N m"
    both = plain(describe(replace(friction(1), name="stribeck_friction", parameters=levels)))
    assert both == "Stribeck friction of 6.90 ± 0.10 N m, 8.40 ± 0.10 N m from rest"


@pytest.mark.parametrize("name", ["axis_coupling", "friction_asymmetry"])
def test_several_strengths_are_as_strong_as_the_one_that_stands_out_most(name: str) -> None:
    weak = ParameterEstimate("velocity", Estimate(8e-4, 4e-4, "N m s/rad"), Estimate(2e-4, 1e-4, "V s/rad"))
    strong = ParameterEstimate("motor_torque", Estimate(-0.166, 7e-4, "1"), Estimate(-0.166, 7e-4, "1"))
    for parameters in ((weak, strong), (strong, weak)):
        said = plain(describe(replace(friction(1), name=name, parameters=parameters)))
        assert said == f"{name.replace('_', ' ')} of −0.1660 ± 0.0007"


def test_heat_acts_on_the_torque_where_the_command_is_no_voltage() -> None:
    rise = ParameterEstimate("resistance_rise", Estimate(0.31, 0.02, "1"), Estimate(0.31, 0.02, "1"))
    drift = replace(friction(1), name="thermal_drift", parameters=(rise,))
    assert plain(describe(drift, "V")) == "thermal drift by 0.310 ± 0.020 times the cold resistance"
    assert plain(describe(drift, "A")) == "thermal drift to 1/(1 + 0.310 ± 0.020) of the cold torque"


def test_corrections_of_a_described_arm_have_a_name_that_people_know() -> None:
    assert parameter_title("arm_shape_2@0") == "torque of the rest of the arm, as described,"
    assert parameter_title("arm_viscous@0") == "arm viscous"


def test_an_effect_that_would_have_to_exceed_the_command_does_not_count_as_visible() -> None:
    result = joint_result(1, "named", "train")
    large = Isolability("input_delay", 1, 3.0, 1.7, "amplifier_lag", 4.2)
    said = adequacy(replace(result, isolability=(*result.isolability, large)))
    assert plain(said[-3]).startswith("1 of 3 known effects would be visible; half of them from 0.030 %")
    assert said[-2:] == [
        "Visible only if they exceed the command's rms: input delay.",
        "Not visible in these logs: axis coupling.",
    ]


def test_a_parameter_that_may_be_nothing_has_its_deviation_in_its_own_unit() -> None:
    joint = joint_result(1, "named", "log")
    behind = nominal("arm_damping", "V s/rad", None, (0.0, 0.0), (0.0, 0.031))
    winding = nominal("electrical_time_constant", "s", None, (0.004, 0.001), (0.004, 0.001))
    said = [plain(line) for line in adequacy(replace(joint, nominal=(behind, winding)))]
    expected = "arm damping (0.000 ± 0.031 V s/rad) and electrical time constant (25 %)"
    assert f"Poorly determined, with relative standard deviation: {expected}." in said


def test_hostile_names_are_text() -> None:
    diagnosis = example("named", log=HOSTILE)
    page = Page(render(diagnosis))
    assert "script" not in page.tags
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert " ".join(HOSTILE.split()) in page.text


def test_a_diagnosis_without_pictures_or_gain_is_a_page_too() -> None:
    full = example("none")
    joint = replace(full.joints[0], series=(), spectrum=None, partial_residuals=())
    bare = replace(joint, isolability=(), nominal=(), remainder=())
    row = replace(full.ledger[0], window_error=None, whole_error=None, inverse_error=None, interval=None, closed=None)
    unmeasured = replace(full.gaps[0], closed=None, interval=None)
    for gaps in ((), (unmeasured,)):
        text = render(replace(full, joints=(bare,), gaps=gaps, ledger=(row,), next_experiment=None))
        assert "None" not in Page(text).text


def test_a_page_is_small() -> None:
    assert len(render(example("named")).encode()) < 1_000_000


@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.name)
def test_every_law_is_typeset(effect) -> None:
    with report_style():
        text = equation(effect.equation, "law")
    assert text.startswith("<svg")
    assert text.count("<use") > 3


def test_damping_of_an_arm_behind_a_spring_has_its_equation_and_no_shift() -> None:
    joint = joint_result(1, "named", "log")
    split = nominal("arm_damping", "V s/rad", None, (0.0, 0.0), (0.0135, 0.0006))
    joint = replace(joint, nominal=(*joint.nominal, split))
    for name in ("joint_flexibility", "backlash"):
        law = next(e for e in built_in() if e.name == name)
        sprung = replace(joint, effects=(replace(joint.effects[0], name=name, equation=law.equation),))
        lines = [formula.tex for formula in model_equations(sprung)]
        assert sum(r"J r\,\ddot q_l + b_l\,\dot q_l = F" in line for line in lines) == 1
        assert any(line.endswith("+ b_l") for line in lines)
        assert any(r"b\,\dot q" in line for line in lines)
    assert split.is_new
    assert split.shift == 0.0
    assert [parameter.name for parameter in joint.nominal if parameter.is_new] == ["arm_damping"]


def test_friction_laws_of_an_arm_behind_a_spring_have_their_share_in_the_equations() -> None:
    joint = joint_result(1, "named", "log")
    share = nominal("arm_friction_share", "1", None, (0.0, 0.0), (0.6, 0.02))
    lines = [formula.tex for formula in model_equations(replace(joint, nominal=(*joint.nominal, share)))]
    assert sum(r"\lambda\,\tau_f(\dot q_l)" in line for line in lines) == 1
    assert not any(r"\lambda" in formula.tex for formula in model_equations(joint))
    with report_style():
        assert all(equation(line, "law").startswith("<svg") for line in lines)


@pytest.mark.parametrize(("joint", "other"), [(1, 2), (2, 1)])
def test_equations_of_a_planar_pair_are_those_of_the_arm(joint: int, other: int) -> None:
    """Lagrange's equations of two links, p1 + p2 + 2 p3 cos q2 and so on, written out and compared as numbers."""
    q1, q2, d1, d2, a1, a2 = 0.7, -1.2, 1.9, -0.6, 3.1, 2.3
    p1, p2, p3, own = 2.0, 0.9, 0.5, 1.1
    single = joint_result(joint, "none", "log")
    nominals = [p for p in single.nominal if p.name in ("inertia", "damping")]
    tex = model_equations(replace(single, nominal=tuple(nominals), effects=(), beside=other))[0].tex
    motions = [(f"q_{other}", (q2, d2, a2)), ("q", (q1, d1, a1))]
    if joint == 2:
        motions = [(f"q_{other}", (q1, d1, a1)), ("q", (q2, d2, a2))]
    left = tex.partition(" = ")[0].replace(r"\,", "*").replace("^2", "**2").replace(" 2 ", " 2*").replace("(2 ", "(2*")
    for name, (angle, rate, acceleration) in motions:
        left = left.replace(rf"\sin {name}", f"*({np.sin(angle)})").replace(rf"\cos {name}", f"*({np.cos(angle)})")
        left = left.replace(rf"\ddot {name}", f"({acceleration})").replace(rf"\dot {name}", f"({rate})")
    found = eval(left, {"J": p1 if joint == 1 else own, "P": p2, "K": p3, "B": 0.0})
    c, s = np.cos(q2), np.sin(q2)
    first = (p1 + p2 + 2 * p3 * c) * a1 + (p2 + p3 * c) * a2 - p3 * s * (2 * d1 + d2) * d2
    second = own * a2 + (p2 + p3 * c) * a1 + p3 * s * d1**2
    assert found == pytest.approx(first if joint == 1 else second)


def test_laws_that_share_a_symbol_are_numbered() -> None:
    joint = joint_result(1, "named", "log")
    drag = next(e for e in built_in() if e.name == "quadratic_drag")
    both = replace(joint, effects=(*joint.effects, replace(joint.effects[0], name=drag.name, equation=drag.equation)))
    lines = [formula.tex for formula in model_equations(both)]
    assert any(r"\tau_{f1} + \tau_{f2}" in line for line in lines)
    assert lines[-2].startswith(r"\tau_{f1} =")
    assert lines[-1].startswith(r"\tau_{f2} =")


def test_the_command_passes_the_effects_of_the_amplifier_one_by_one() -> None:
    joint = joint_result(1, "named", "log")
    laws = {e.name: e.equation for e in built_in()}

    def lines(*names: str) -> list[str]:
        own = replace(joint.effects[0], stage="amplifier")
        effects = tuple(replace(own, name=name, equation=laws[name]) for name in names)
        return [formula.tex for formula in model_equations(replace(joint, effects=effects))][-len(names) :]

    assert lines("dead_zone") == [
        laws["dead_zone"].replace("v - v_0", "u - v_0").replace("(v)", "(u)").replace("|v|", "|u|")
    ]
    assert lines("amplifier_lag", "amplifier_offset", "input_delay") == [
        r"T\,\dot v_a + v_a = v_2",
        "v_2 = v_1 + v_{off}",
        "v_1(t) = u(t - T_d)",
    ]
    assert [line.partition(" =")[0] for line in lines("dead_zone", "amplifier_offset")] == ["v_a", "v_1"]
    behind = lines("amplifier_offset_at_output", "amplifier_lag", "dead_zone")
    assert behind[0].startswith("v_a = v_2 + v_{off}")
    assert [line.partition(" =")[0] for line in behind[1:]] == [r"T\,\dot v_2 + v_2", "v_1"]


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (6.912, 0.118, "N m", "6.91 ± 0.12 N m"),
        (6.912, 0.36, "N m", "6.9 ± 0.4 N m"),
        (0.0967448, 1.9e-6, "V", "96.7448 ± 0.0019 mV"),
        (0.0080404, 4.3e-6, "s", "8.040 ± 0.004 ms"),
        (1234567.0, 2345.0, "N m/rad", "(1.2346 ± 0.0023) × 10⁶ N m/rad"),
        (35.9976, 0.0281, "1/rev", "35.998 ± 0.028 1/rev"),
        (-0.5, 0.02, "1", "−0.500 ± 0.020"),
        (1.0, 1e9, "rad/s", "1.00 rad/s (not determined)"),
        (2.5, 0.0, "N m", "2.500 N m"),
    ],
)
def test_a_number_is_rounded_by_its_deviation(value: float, std: float, unit: str, text: str) -> None:
    assert measured(value, std, unit).replace("\u00a0", " ") == text


def test_numbers_for_people() -> None:
    assert quantity(0.0412, "rad") == "41.2\u00a0mrad"
    assert quantity(0.99999, "V") == "1.00\u00a0V"
    assert quantity(0.0412, "V s^2/rad") == "0.0412\u00a0V\u00a0s²/rad"
    assert number(999.9) == "1000"
    assert number(1.5e-7, 2) == "1.5 × 10⁻⁷"
    assert number(None) == number(float("nan")) == "–"
    assert percent(0.99999) == "> 99.9\u00a0%"
    assert percent(1.0) == "100\u00a0%"
    assert percent(-3.03) == "\u2212303\u00a0%"
    assert percent(-672.4) == "\u2212672\u00a0×"
    assert unbroken("from 41 to 3 mrad") == "from 41 to 3\u00a0mrad"
    assert unbroken("6.9 ± 0.1 N m is") == "6.9\u00a0±\u00a00.1\u00a0N\u00a0m is"


def test_a_simulation_that_runs_away_is_said_and_not_measured() -> None:
    sound = np.full(50, 1e-3)
    away = np.where(np.arange(50) > 40, DIVERGED, 1e-3)
    assert simulated(sound, sound) == (pytest.approx(1e-3), pytest.approx(1e-3), "")
    assert simulated(sound, away) == (pytest.approx(1e-3), None, "diverges over the whole log")
    assert simulated(away, away)[:2] == (None, None)
    words = gain(Gap(1, "rad", 0.04, 4e5, 0.001, None, None, "held-out"))
    assert words == "makes the simulation run away on the held-out logs"
    words = gain(Gap(1, "rad", 5e5, 4e5, 0.001, None, None, "held-out"))
    assert words == "leaves the simulation running away on the held-out logs"


def test_a_nominal_model_that_runs_away_has_no_error_in_numbers() -> None:
    away = Gap(1, "rad", 2.4e5, 0.413, 0.002, closed(0.413, 2.4e5, 0.002), None, "held-out")
    assert gain(away) == "makes the held-out error 413 mrad where the nominal model runs away, noise floor 2.00 mrad"
    assert away.closed is None
    diagnosis = example("named")
    page = Page(render(replace(diagnosis, gaps=(away,)))).text
    assert "runs away" in page
    assert "krad" not in page


def test_names_are_listed_as_in_a_sentence() -> None:
    assert [enumerated("abc"[:count]) for count in range(4)] == ["", "a", "a and b", "a, b and c"]
