"""The gymnasium environment: contracts of gymnasium and stable-baselines3, any simulator, pictures, learning."""

import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_for_gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_for_stable_baselines
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from envs.adeptone import adeptone
from envs.gym_env import AdeptOneEnv
from envs.mjcf import robot_spec
from envs.mujoco_simulator import MujocoSimulator
from envs.registration import ENVIRONMENT, register
from envs.rendering import RenderingError, RobotRenderer, render_robot
from envs.simulator import KernelSimulator

ROOT = Path(__file__).resolve().parents[1]
POSE = np.array([-0.5, 0.9, 0.06, 0.4])


class StillRobot:
    """The least that a simulator can be: the robot never moves."""

    robot, sample_time, held = adeptone(), 1e-3, (3,)

    def reset(self, position, rng):
        self.position = np.asarray(position)
        return self.position

    def step(self, command, periods=1):
        return self.position


@pytest.fixture(params=["kernel", "mujoco", "foreign"])
def simulator(request):
    if request.param == "kernel":
        return KernelSimulator(adeptone(second_stator="base"), held=(4,))
    return MujocoSimulator(adeptone(), held=(4,)) if request.param == "mujoco" else StillRobot()


@pytest.mark.filterwarnings("ignore")
def test_passes_the_checkers_on_any_simulator(simulator):
    environment = gymnasium.make(ENVIRONMENT, simulator=simulator).unwrapped
    check_for_gymnasium(environment, skip_render_check=True)
    check_for_stable_baselines(environment)
    assert environment.action_space.shape == (3,)
    assert environment.observation_space.shape == (9,)


def test_action_is_in_volts_and_the_servo_runs_at_one_kilohertz():
    environment = gymnasium.make(ENVIRONMENT)
    assert environment.action_space.high == pytest.approx(10.0)
    assert environment.metadata["render_fps"] == 1000
    environment.reset(seed=0)
    steps = 0
    truncated = False
    while not truncated:
        *_, truncated, _ = environment.step(np.zeros(4, dtype=np.float32))
        steps += 1
    assert steps == 2000


def test_same_seed_gives_the_same_bits():
    def episode(seed):
        environment = gymnasium.make(ENVIRONMENT)
        environment.action_space.seed(seed)
        observations = [environment.reset(seed=seed)[0]]
        observations += [environment.step(environment.action_space.sample())[0] for _ in range(20)]
        return np.array(observations)

    assert np.array_equal(episode(3), episode(3))
    assert not np.array_equal(episode(3), episode(4))


def test_observation_is_what_the_sensors_give():
    """Positions are whole encoder steps, velocity is their difference, and a voltage moves its joint its way."""
    robot = adeptone()
    environment = gymnasium.make(ENVIRONMENT, periods=5)
    environment.reset(seed=0, options={"position": POSE, "target": POSE})
    before = robot.measure(POSE)
    observation, *_ = environment.step(np.array([1.0, -1.0, 0.0, 1.0], dtype=np.float32))
    position = environment.unwrapped.simulator.robot.measure(observation[:4].astype(float))
    assert observation[:4] == pytest.approx(position, abs=1e-6)
    assert observation[4:8] == pytest.approx((position - before) / 5e-3, abs=1e-3)
    assert observation[4] > 0.0 > observation[5]
    assert observation[8:] == pytest.approx(POSE)


def test_reward_is_highest_at_the_target():
    environment = gymnasium.make(ENVIRONMENT, joints=(1,))
    rewards = {}
    for distance in (0.0, 0.1, 1.0):
        environment.reset(seed=0, options={"position": [0.2], "target": [0.2 + distance]})
        _, rewards[distance], _, _, info = environment.step(np.zeros(1, dtype=np.float32))
        assert info["success"] == (distance == 0.0)
    assert rewards[0.0] > 0.9 > 0.0 > rewards[0.1] > rewards[1.0]


def test_held_joints_stay(simulator):
    start = simulator.reset(POSE, np.random.default_rng(0))
    end = simulator.step(np.array([5.0, -5.0, 5.0, 5.0]), 50)
    for number in simulator.held:
        assert end[number - 1] == start[number - 1]


def test_mujoco_and_kernel_are_the_same_environment():
    """To the first order of MuJoCo's current in the step; see envs.mjcf."""
    ends = []
    for simulator in (KernelSimulator(adeptone()), MujocoSimulator(adeptone())):
        simulator.reset(POSE, np.random.default_rng(0))
        ends.append(simulator.step(np.array([0.5, 0.5, 1.0, 0.3]), 200))
    assert ends[0] - POSE == pytest.approx(ends[1] - POSE, rel=0.03)


def test_a_simulator_needs_a_timestep_that_divides_its_period():
    spec = robot_spec(adeptone(), timestep=3e-4)
    with pytest.raises(ValueError, match="does not divide"):
        MujocoSimulator(adeptone(), spec=spec)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments(mode):
    environments = gymnasium.make_vec(ENVIRONMENT, num_envs=2, vectorization_mode=mode)
    observations, _ = environments.reset(seed=[1, 2])
    alone, _ = gymnasium.make(ENVIRONMENT).reset(seed=2)
    assert np.array_equal(observations[1], alone)
    assert environments.step(environments.action_space.sample())[0].shape == (2, 12)
    environments.close()


def test_registering_again_changes_nothing():
    spec = gymnasium.spec(ENVIRONMENT)
    register()
    assert gymnasium.spec(ENVIRONMENT) is spec


@pytest.mark.parametrize(("arguments", "words"), [({"render_mode": "human"}, "rgb_array"), ({"joints": ()}, "held")])
def test_wrong_arguments_are_explained(arguments, words):
    with pytest.raises(ValueError, match=words):
        AdeptOneEnv(**arguments)


def test_picture_shows_the_arm_and_its_pose():
    try:
        environment = gymnasium.make(ENVIRONMENT, render_mode="rgb_array", width=320, height=240)
        environment.reset(seed=0, options={"position": POSE})
        picture = environment.render()
    except RenderingError as error:
        pytest.skip(str(error))
    assert picture.shape == (240, 320, 3)
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    ivory = (red > blue + 12) & (abs(red - green) < 25)
    signal_red = red > green + 60
    assert 0.03 < ivory.mean() < 0.4
    assert signal_red.any()
    environment.reset(seed=0, options={"position": -POSE * [1, 1, -1, 1]})
    moved = environment.render()
    assert (np.abs(moved.astype(int) - picture).max(axis=-1) > 30).mean() > 0.02
    environment.close()


def test_pictures_and_torch_live_in_one_program():
    """Software OpenGL and torch's compiler crash in one process; see envs.rendering."""
    program = "import numpy as np; from envs.adeptone import adeptone; from envs.rendering import render_robot; " + (
        "render_robot(adeptone(), np.zeros(4)); import torch._dynamo"
    )
    try:
        render_robot(adeptone(), POSE)
    except RenderingError as error:
        pytest.skip(str(error))
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0


def test_a_machine_without_opengl_says_what_to_install(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(RenderingError, match="libegl1 or libosmesa6") as caught:
        render_robot(adeptone(), POSE)
    assert "\n" not in str(caught.value)


def test_a_closed_renderer_says_so():
    try:
        renderer = RobotRenderer(adeptone(), width=64, height=48)
    except RenderingError as error:
        pytest.skip(str(error))
    renderer.close()
    with pytest.raises(RenderingError, match="Make a new renderer"):
        renderer.render(POSE)


def _one_joint():
    environment = gymnasium.make(ENVIRONMENT, joints=(1,), periods=25, duration=1.5, reach=0.4)
    return gymnasium.wrappers.RescaleAction(environment, np.float32(-1.0), np.float32(1.0))


@pytest.mark.filterwarnings("ignore")
def test_ppo_learns_to_reach_with_joint_1():
    """Joint 1 alone at 40 Hz. Of the 60 steps of an episode about 50 can be spent at the target."""
    model = PPO(
        "MlpPolicy",
        make_vec_env(_one_joint, n_envs=8, seed=0),
        seed=0,
        n_steps=128,
        batch_size=256,
        learning_rate=1e-3,
        gamma=0.95,
        gae_lambda=0.9,
        policy_kwargs={"net_arch": [32, 32]},
        device="cpu",
    )
    before, _ = evaluate_policy(model, make_vec_env(_one_joint, seed=100), n_eval_episodes=20)
    model.learn(20_000)
    after, _ = evaluate_policy(model, make_vec_env(_one_joint, seed=100), n_eval_episodes=20)
    assert before < 10.0
    assert after > 30.0
