#!/usr/bin/env python3
# /// script
# requires-python = ">=3.11"
# dependencies = ["ale-py==0.12.1", "gymnasium==1.4.0", "mcap==1.6.0", "numpy==2.4.6"]
# ///
"""Record what an agent does in Gymnasium or ALE environments, as a recording that coact reads (MCAP).

Input: an environment, and a policy: random, scripted, or a stable-baselines3 model. Or, as a module, the environment of
your own training loop: wrap it in `RecordRollouts`, or a vector environment in `RecordVectorRollouts`.

Output: an MCAP file with one JSON message a step on the topic `/step`:
  {"episode": 0, "step": 0, "action": 1, "state": [0.1, …], "reward": 1.0, "terminated": false, "truncated": false}
`state` is the observation the action was chosen from. Dict and Tuple spaces are laid out flat, Dicts in the order of
their sorted keys; discrete values are plain integers. A value that is not finite is an error (JSON has no NaN): its
step is not written. A metadata record `recording` names environment, rate, actions and states. Times advance at the
environment's rate, from the moment the recording began; where no rate is known, they are those of the wall clock.

The file is whole up to the last finished episode at any moment, so it can be extracted while training goes on: by
`coact watch` each episode as it ends, by `coact extract` (which then exits with 3, since the end of the file is missing). An episode that is cut short just has no last step with
`terminated` or `truncated`. Above 64 sub-environments, extract with a larger `--max-open-episodes`.

Example: record_rollouts.py CartPole-v1 cartpole.mcap --episodes 3 --policy scripted --seed 1

  from record_rollouts import RecordRollouts
  with RecordRollouts(gym.make("CartPole-v1"), "training.mcap", policy="DQN") as env:
      train(env)
"""

from __future__ import annotations

import argparse
import importlib.metadata
import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from mcap.writer import CompressionType, Writer

from scripted_policies import Policy, scripted_policy

TOPIC = "/step"
NANOS_PER_SECOND = 1_000_000_000
ATARI_FRAMES_PER_SECOND = 60
# Names of an image's pixels would say nothing and take more room than a step.
MAX_NAMED_COLUMNS = 1024
LIBRARIES = ("gymnasium", "ale-py", "mujoco", "gymnasium-robotics", "stable-baselines3", "numpy", "mcap")

ACTION_NAMES: dict[str, Sequence[str]] = {
    "Acrobot-v1": ("torque",),
    "CartPole-v0": ("push",),
    "CartPole-v1": ("push",),
    "MountainCar-v0": ("accelerate",),
    "MountainCarContinuous-v0": ("force",),
    "Pendulum-v1": ("torque",),
}
STATE_NAMES: dict[str, Sequence[str]] = {
    "Acrobot-v1": ("cos1", "sin1", "cos2", "sin2", "dtheta1", "dtheta2"),
    "CartPole-v0": ("cart_pos", "cart_vel", "pole_angle", "pole_ang_vel"),
    "CartPole-v1": ("cart_pos", "cart_vel", "pole_angle", "pole_ang_vel"),
    "MountainCar-v0": ("position", "velocity"),
    "MountainCarContinuous-v0": ("position", "velocity"),
    "Pendulum-v1": ("cos_theta", "sin_theta", "theta_dot"),
}

NUMBER_OR_ARRAY = {"oneOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]}
STEP_SCHEMA = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "RolloutStep",
    "type": "object",
    "properties": {
        "episode": {"type": "integer", "description": "number of the episode in this recording"},
        "step": {"type": "integer", "description": "number of the step in its episode"},
        "action": NUMBER_OR_ARRAY,
        "state": {**NUMBER_OR_ARRAY, "description": "the observation the action was chosen from"},
        "reward": {"type": "number"},
        "terminated": {"type": "boolean"},
        "truncated": {"type": "boolean"},
    },
    "required": ["episode", "step", "action", "state", "reward", "terminated", "truncated"],
}

Number = int | float
Values = Number | list[Number]


@dataclass(frozen=True)
class RecordingOptions:
    """How to record; every field is a keyword argument of the wrappers."""

    overwrite: bool = False
    """Replace an existing file."""
    env_id: str | None = None
    """Name of the environment, if it was not made by `gymnasium.make`."""
    policy: str = ""
    """What chose the actions, for the metadata."""
    rate_hz: float | None = None
    """Steps a second, if the environment does not tell."""
    action_names: Sequence[str] | None = None
    state_names: Sequence[str] | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    """More entries of the metadata record."""
    start_time_nanos: int | None = None
    """Time of the first step. Given, and with a known rate, the same steps make the same file."""
    chunk_size: int = 1 << 20
    """Bytes of JSON after which a chunk ends within an episode. Each finished episode ends one, too."""
    max_episodes: int | None = None
    """Episodes that begin after this many are not recorded."""


class RecordRollouts(gym.Wrapper):
    """Records each step of an environment. `close()`, or leaving a `with` block, finishes the file."""

    def __init__(self, env: gym.Env, path: str | Path, **options: Any) -> None:
        super().__init__(env)
        self.recorder = Recorder(path, description_of(env), RecordingOptions(**options))
        # The wrapper Autoreset turns the step after an episode's last into a reset.
        self._resets_itself = any(isinstance(layer, gym.wrappers.Autoreset) for layer in layers(env))
        self._episode: Episode | None = None
        self._state: Values = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = super().reset(seed=seed, options=options)
        self.recorder.describe_once(seed)
        self.recorder.flush()
        self._begin(observation)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        if self._episode is None and not self._resets_itself:
            raise gym.error.ResetNeeded("an episode begins with reset(), also after the last step of another")
        # Taken before the step: environments may work in place.
        chosen = plain(action)
        observation, reward, terminated, truncated, info = super().step(action)
        if self._episode is None:
            self._begin(observation)
            return observation, reward, terminated, truncated, info
        self.recorder.write(self._episode, chosen, self._state, reward, terminated, truncated)
        self.recorder.tick()
        self._state = plain(observation)
        if terminated or truncated:
            self._episode = None
            self.recorder.flush()
        return observation, reward, terminated, truncated, info

    def close(self) -> None:
        try:
            super().close()
        finally:
            self.recorder.close()

    def _begin(self, observation: Any) -> None:
        self._episode, self._state = Episode(), plain(observation)


class RecordVectorRollouts(VectorWrapper):
    """Records each step of each sub-environment of a vector environment; their episodes interleave.

    Episodes are numbered in the order in which they begin, by sub-environment where they begin together.
    """

    def __init__(
        self,
        env: VectorEnv,
        path: str | Path,
        *,
        autoreset_mode: AutoresetMode | str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(env)
        mode = autoreset_mode or env.metadata.get("autoreset_mode")
        if mode is None:
            raise ValueError("the environment's metadata has no autoreset_mode; give it as an argument")
        self._mode = AutoresetMode(mode)
        self.recorder = Recorder(path, description_of(env), RecordingOptions(**options))
        self._episodes: list[Episode | None] = [None] * env.num_envs
        self._states: list[Values] = []

    def __enter__(self) -> RecordVectorRollouts:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        # Read before the reset, which takes it out of the options.
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        sub_seeds: Any = seed  # the base class is typed for one seed, and takes one for each, too
        observations, infos = super().reset(seed=sub_seeds, options=options)
        self.recorder.describe_once(seed)
        self.recorder.flush()
        states = plain_each(self.env.observation_space, observations)
        self._states = self._states or states
        for index, state in enumerate(states):
            if mask[index]:
                self._begin(index, state)
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        if not self._states:
            raise gym.error.ResetNeeded("the first episodes begin with reset()")
        if self._mode is AutoresetMode.DISABLED and None in self._episodes:
            ended = [index for index, episode in enumerate(self._episodes) if episode is None]
            raise gym.error.ResetNeeded(f"sub-environments {ended} ended: call reset() with a reset_mask")
        # Taken before the step: environments may work in place.
        chosen = plain_each(self.env.action_space, actions)
        result = super().step(actions)
        observations, rewards, terminations, truncations, _ = result
        states = plain_each(self.env.observation_space, observations)
        for index, state in enumerate(states):
            episode = self._episodes[index]
            if episode is None:
                # Mode NEXT_STEP: this step was a reset, and its action went nowhere.
                self._begin(index, state)
                continue
            terminated, truncated = bool(terminations[index]), bool(truncations[index])
            self.recorder.write(episode, chosen[index], self._states[index], rewards[index], terminated, truncated)
            self._states[index] = state
            if terminated or truncated:
                self._end(index, state)
        self.recorder.tick()
        if np.any(terminations) or np.any(truncations):
            self.recorder.flush()
        return result

    def close(self, **kwargs: Any) -> None:
        try:
            super().close(**kwargs)
        finally:
            self.recorder.close()

    def _begin(self, index: int, state: Values) -> None:
        self._episodes[index], self._states[index] = Episode(), state

    def _end(self, index: int, state: Values) -> None:
        self._episodes[index] = None
        if self._mode is AutoresetMode.SAME_STEP:
            # The observation is already the first of the next episode.
            self._begin(index, state)


# The file -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Description:
    """What an environment tells about itself."""

    env_id: str | None
    rate_hz: float | None
    action_names: Sequence[str]
    action_values: Sequence[str]
    state_names: Sequence[str]
    state_shape: Sequence[int]


@dataclass
class Episode:
    """An episode. It gets its number with its first step: a reset that nothing follows is no episode."""

    number: int | None = None
    n_steps: int = 0
    episode_return: float = 0.0


class Recorder:
    """Writes steps to a file, which is whole up to the last `flush()` whatever happens after."""

    def __init__(self, path: str | Path, description: Description, options: RecordingOptions) -> None:
        self.path = Path(path)
        self.description = description
        self.options = options
        self.rate_hz = options.rate_hz or description.rate_hz
        if self.rate_hz is None and options.start_time_nanos is not None:
            raise ValueError("a start time needs a rate, and the environment tells none: give rate_hz")
        self.finished: list[Episode] = []
        """The episodes that came to their end, in the order in which they did."""
        self.n_steps = 0
        self._n_episodes = 0
        self._described = False
        self._clock = clock(options.start_time_nanos, self.rate_hz)
        self._log_time_nanos = next(self._clock)
        self._stream = create(self.path, overwrite=options.overwrite)
        self._writer: Writer | None = Writer(
            self._stream, chunk_size=options.chunk_size, compression=CompressionType.ZSTD
        )
        self._writer.start(library="record_rollouts.py")
        schema = self._writer.register_schema("RolloutStep", "jsonschema", json.dumps(STEP_SCHEMA).encode())
        self._channel = self._writer.register_channel(TOPIC, "json", schema)

    def describe_once(self, seed: Any) -> None:
        """Writes the metadata record if it is not there yet; `seed` is that of the first reset."""
        if self._writer is not None and not self._described:
            self._described = True
            self._writer.add_metadata("recording", metadata_entries(self, seed))

    def write(
        self, episode: Episode, action: Values, state: Values, reward: Any, terminated: bool, truncated: bool
    ) -> None:
        """Writes the next step of an episode."""
        if self._writer is None:
            raise ValueError(f"{self.path} is closed")
        if episode.number is None:
            if self._n_episodes == self.options.max_episodes:
                return
            episode.number = self._n_episodes
            self._n_episodes += 1
        step: dict[str, Any] = {
            "episode": episode.number,
            "step": episode.n_steps,
            "action": action,
            "state": state,
            "reward": np.asarray(reward, dtype=np.float64).item(),
            "terminated": bool(terminated),
            "truncated": bool(truncated),
        }
        # Counted even if it cannot be written: a gap says that the episode is not whole.
        episode.n_steps += 1
        data = encoded(step, self.path)
        self._writer.add_message(
            self._channel, self._log_time_nanos, data, self._log_time_nanos, sequence=self.n_steps & 0xFFFF_FFFF
        )
        self.n_steps += 1
        episode.episode_return += step["reward"]
        if terminated or truncated:
            self.finished.append(episode)

    def tick(self) -> None:
        """Moves the time on to the next step; sub-environments that step together share their times."""
        self._log_time_nanos = next(self._clock)

    def flush(self) -> None:
        """Ends the chunk and hands it to the system, so that all steps up to here can be read."""
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """Finishes the file. Does nothing the second time."""
        if self._writer is None:
            return
        self.describe_once(seed=None)
        writer, self._writer = self._writer, None
        try:
            writer.finish()
        finally:
            self._stream.close()


def create(path: Path, *, overwrite: bool) -> BinaryIO:
    """Opens a new file under its final name: it is to be read while it grows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return path.open("wb" if overwrite else "xb")
    except FileExistsError as error:
        raise FileExistsError(f"{path} exists: choose another name, or overwrite it") from error


def clock(start_time_nanos: int | None, rate_hz: float | None) -> Iterator[int]:
    """Times of the steps: regular at the environment's rate, which training does not keep; else those of the wall."""
    start = time.time_ns() if start_time_nanos is None else start_time_nanos
    if rate_hz is not None:
        for n_steps in itertools.count():
            yield start + round(n_steps * NANOS_PER_SECOND / rate_hz)
    latest = start
    while True:
        yield latest
        # The wall clock can be set back; the times of a recording never go back.
        latest = max(latest + 1, time.time_ns())


def encoded(step: dict[str, Any], path: Path) -> bytes:
    """A step as JSON, which has no NaN and no infinity."""
    try:
        return json.dumps(step, separators=(",", ":"), allow_nan=False).encode()
    except ValueError as error:
        bad = [name for name in ("action", "state", "reward") if not np.all(np.isfinite(step[name]))]
        place = f"{path}: episode {step['episode']}, step {step['step']}"
        raise ValueError(f"{place}: {' and '.join(bad)} not finite, which JSON cannot hold") from error


def metadata_entries(recorder: Recorder, seed: Any) -> dict[str, str]:
    """Entries of the metadata record; what is not known is left out."""
    options, description = recorder.options, recorder.description
    entries = {
        "env_id": options.env_id or description.env_id,
        "rate_hz": recorder.rate_hz and f"{recorder.rate_hz:.12g}",
        "policy": options.policy,
        "seed": seed is not None and json.dumps(seed, default=int),
        "action_names": as_json(options.action_names or description.action_names),
        "action_values": as_json(description.action_values),
        "state_names": as_json(options.state_names or description.state_names),
        "state_shape": as_json(description.state_shape),
        **library_versions(),
        **options.metadata,
    }
    return {name: text for name, text in entries.items() if text}


def as_json(values: Sequence[Any]) -> str:
    return json.dumps(list(values)) if values else ""


def library_versions() -> dict[str, str]:
    """Versions of what is installed and bears on a rollout."""
    versions = {}
    for name in LIBRARIES:
        try:
            versions[name.replace("-", "_")] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


# Values as JSON holds them --------------------------------------------------------------------------------------------


def plain(value: Any) -> Values:
    """A number, or a flat list of numbers, with the exact values of the observation or action."""
    if isinstance(value, Mapping):
        return [number for key in sorted(value) for number in as_list(plain(value[key]))]
    if isinstance(value, tuple | list):
        return [number for part in value for number in as_list(plain(part))]
    array = np.asarray(value)
    if array.dtype.kind == "b":
        array = array.astype(np.uint8)
    elif array.dtype.kind == "f":
        # As it is the same number, Python's shortest text of it is exact for float32, too.
        array = array.astype(np.float64)
    elif array.dtype.kind not in "iu":
        raise TypeError(f"only numbers can be recorded, not {array.dtype} ({value!r:.100})")
    return array.ravel().tolist() if array.ndim else array.item()


def plain_each(space: gym.Space, batch: Any) -> list[Values]:
    """The values of each sub-environment in a batch of a vector environment's space."""
    return [plain(value) for value in iterate(space, batch)]


def as_list(values: Values) -> list[Number]:
    return values if isinstance(values, list) else [values]


# What environments tell about themselves ------------------------------------------------------------------------------


def description_of(env: gym.Env | VectorEnv) -> Description:
    """What is known of an environment, or of the sub-environments of a vector environment."""
    if isinstance(env, VectorEnv):
        action_space, state_space = env.single_action_space, env.single_observation_space
        # Only those that run in this process can be asked; the others have at least a spec and metadata.
        one = next(iter(getattr(env.unwrapped, "envs", ())), env)
    else:
        action_space, state_space, one = env.action_space, env.observation_space, env
    env_id = one.spec.id if one.spec else ""
    atari = is_atari(one)
    action_names = ("joystick",) if atari else ACTION_NAMES.get(env_id, ())
    action_stem, state_stem = "action", "ram" if atari and state_space.shape == (128,) else "state"
    return Description(
        env_id=env_id or None,
        rate_hz=rate_of(one),
        action_names=known(action_names, action_space, action_stem),
        action_values=one.unwrapped.get_action_meanings() if hasattr(one.unwrapped, "get_action_meanings") else (),
        state_names=known(STATE_NAMES.get(env_id, ()), state_space, state_stem),
        state_shape=state_space.shape if state_space.shape and len(state_space.shape) > 1 else (),
    )


def known(names: Sequence[str], space: gym.Space, stem: str) -> Sequence[str]:
    """`names` if they fit, else numbered ones; none at all for images. Wrappers may have changed the space."""
    numbered = column_names(space, stem)
    if len(numbered) > MAX_NAMED_COLUMNS:
        return ()
    if len(names) == len(numbered):
        return names
    return [f"{stem}_0"] if numbered == [stem] else numbered


def column_names(space: gym.Space, stem: str) -> list[str]:
    """A name for each number in `plain()` of a value of the space."""
    parts: list[tuple[str, gym.Space]]
    if isinstance(space, spaces.Dict):
        # The keys say enough without the stem of the whole.
        prefix = "" if stem in ("action", "state") else f"{stem}."
        parts = [(f"{prefix}{key}", space[key]) for key in sorted(space.keys())]
    elif isinstance(space, spaces.Tuple):
        parts = [(f"{stem}_{index}", part) for index, part in enumerate(space)]
    elif isinstance(space, spaces.Discrete | spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        shape = space.shape or ()
        return [f"{stem}_{index}" for index in range(math.prod(shape))] if shape else [stem]
    else:
        raise TypeError(f"values of {space} have no fixed number of columns and cannot be recorded")
    return [name for part_stem, part in parts for name in column_names(part, part_stem)]


def rate_of(env: gym.Env | VectorEnv) -> float | None:
    """Steps a second of simulated time. Only if an environment does not tell them, the rate it is drawn at."""
    if is_atari(env):
        frames = env.spec.kwargs.get("frameskip") if env.spec else None
        preprocessing = [layer for layer in layers(env) if isinstance(layer, gym.wrappers.AtariPreprocessing)]
        repeats = math.prod(layer.frame_skip for layer in preprocessing)
        return ATARI_FRAMES_PER_SECOND / (frames * repeats) if isinstance(frames, int) else None
    for name in ("dt", "tau"):
        seconds = getattr(env.unwrapped, name, None)
        if isinstance(seconds, int | float) and seconds > 0:
            return 1 / float(seconds)
    return env.metadata.get("render_fps")


def is_atari(env: gym.Env | VectorEnv) -> bool:
    return bool(env.spec and env.spec.id.startswith("ALE/")) or hasattr(env.unwrapped, "ale")


def layers(env: Any) -> Iterator[Any]:
    """The wrappers of an environment, from the outermost on, and the environment itself."""
    yield env
    while isinstance(env, gym.Wrapper):
        env = env.env
        yield env


# Command line ---------------------------------------------------------------------------------------------------------

NewPolicy = Callable[[gym.Env], Policy]
"""Makes a policy for one episode of an environment."""


def record(args: argparse.Namespace) -> Recorder:
    """Records the rollouts that the command line asks for."""
    new_policy = policy_maker(args.policy, args.epsilon, args.seed)
    options = {
        "overwrite": args.overwrite,
        "policy": args.policy + (f", epsilon {args.epsilon:g}" if args.epsilon else ""),
        "rate_hz": args.rate,
        "start_time_nanos": args.start_time,
        "chunk_size": args.chunk_size,
        "max_episodes": args.episodes,
        "metadata": {"env_kwargs": json.dumps(env_kwargs(args))},
    }
    env = make_env(args)
    if args.policy == "scripted":
        # Says that there is none for this environment before a file is begun.
        scripted_policy(env)
    if args.n_envs == 1:
        with RecordRollouts(env, args.recording, **options) as recorded:
            roll_out(recorded, new_policy, args.episodes, args.seed)
            return recorded.recorder
    env.close()
    vector = gym.vector.SyncVectorEnv([lambda: make_env(args)] * args.n_envs, autoreset_mode=AutoresetMode.SAME_STEP)
    with RecordVectorRollouts(vector, args.recording, **options) as recorded:
        roll_out_vector(recorded, new_policy, args.episodes, args.seed)
        return recorded.recorder


def roll_out(env: RecordRollouts, new_policy: NewPolicy, n_episodes: int, seed: int | None) -> None:
    """Plays whole episodes, one after the other. Only the first reset is seeded: the others follow from it."""
    for episode in range(n_episodes):
        observation, _ = env.reset(seed=seed if episode == 0 else None)
        policy, ended = new_policy(env), False
        while not ended:
            observation, _, terminated, truncated, _ = env.step(policy(observation))
            ended = terminated or truncated


def roll_out_vector(env: RecordVectorRollouts, new_policy: NewPolicy, n_episodes: int, seed: int | None) -> None:
    """Plays until the first `n_episodes` to begin have ended: to take the first to end would favour short ones."""
    vector: Any = env.unwrapped
    envs: list[gym.Env] = vector.envs
    observations, _ = env.reset(seed=seed)
    policies = [new_policy(one) for one in envs]
    while len(env.recorder.finished) < n_episodes:
        each = iterate(env.observation_space, observations)
        actions = [policy(observation) for policy, observation in zip(policies, each, strict=True)]
        empty: Any = create_empty_array(env.single_action_space, len(actions))
        batch = concatenate(env.single_action_space, actions, empty)
        observations, _, terminations, truncations, _ = env.step(batch)
        for index in np.flatnonzero(terminations | truncations):
            policies[index] = new_policy(envs[index])


def policy_maker(text: str, epsilon: float, seed: int | None) -> NewPolicy:
    """What `--policy` names, with a random action now and then."""
    kind, _, model = text.partition(":")
    if kind == "sb3" and model:
        predict = sb3_policy(model)
    elif text not in ("random", "scripted"):
        raise ValueError(f"no policy {text!r}: it is random, scripted, or sb3:MODEL.zip[:ALGORITHM]")
    seeds = itertools.count(seed) if seed is not None else itertools.repeat(None)
    dice = np.random.default_rng(seed)

    def new_policy(env: gym.Env) -> Policy:
        env.action_space.seed(next(seeds))

        def sample(_observation: Any) -> Any:
            return env.action_space.sample()

        if kind == "random":
            return sample
        chosen = predict if kind == "sb3" else scripted_policy(env)
        if not epsilon:
            return chosen
        return lambda observation: (sample if dice.random() < epsilon else chosen)(observation)

    return new_policy


def sb3_policy(model: str) -> Policy:
    """The policy of a stable-baselines3 model file, `MODEL.zip[:ALGORITHM]`; without an algorithm, of PPO."""
    path, algorithm = (model, "PPO") if model.endswith(".zip") or ":" not in model else model.rsplit(":", 1)
    try:
        import stable_baselines3  # noqa: PLC0415  large, and needed for nothing else
    except ImportError as error:
        raise ValueError("policy sb3 needs stable-baselines3: pip install stable-baselines3") from error
    if not hasattr(stable_baselines3, algorithm):
        raise ValueError(f"stable-baselines3 has no algorithm {algorithm!r}")
    loaded = getattr(stable_baselines3, algorithm).load(path, device="cpu")
    return lambda observation: loaded.predict(observation, deterministic=True)[0]


def make_env(args: argparse.Namespace) -> gym.Env:
    return gym.make(args.env_id, max_episode_steps=args.max_steps, **env_kwargs(args))


def env_kwargs(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of the environment; ALE games show their RAM unless told otherwise."""
    atari = args.env_id.startswith("ALE/")
    if args.obs_type and not atari:
        raise ValueError("--obs-type is for ALE environments only")
    return ({"obs_type": args.obs_type or "ram"} if atari else {}) | args.env_kwargs


def register_atari(env_id: str) -> None:
    """Makes the ALE environments known, which nothing else does."""
    try:
        import ale_py  # noqa: PLC0415  optional
    except ImportError as error:
        if env_id.startswith("ALE/"):
            raise ValueError(f"{env_id} needs ale-py: pip install ale-py") from error
        return
    ale_py.ALEInterface.setLoggerMode(ale_py.LoggerMode.Error)
    gym.register_envs(ale_py)


def positive(text: str) -> int:
    if (number := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return number


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env_id", metavar="ENV_ID", help="as for gymnasium.make, also module:ENV_ID")
    parser.add_argument("recording", metavar="OUT.mcap", type=Path, help="the file to write")
    parser.add_argument("--episodes", type=positive, default=1, metavar="N", help="episodes to record [1]")
    parser.add_argument("--max-steps", type=positive, metavar="M", help="truncate each episode after M steps")
    parser.add_argument("--seed", type=int, metavar="S", help="seed of the environment and of random actions")
    parser.add_argument("--policy", default="random", help="random, scripted or sb3:MODEL.zip[:ALGORITHM] [random]")
    parser.add_argument("--epsilon", type=float, default=0.0, metavar="P", help="share of random actions [0]")
    parser.add_argument("--n-envs", type=positive, default=1, metavar="K", help="environments side by side [1]")
    parser.add_argument("--obs-type", choices=("ram", "grayscale", "rgb"), help="observations of ALE games [ram]")
    parser.add_argument("--env-kwargs", type=json.loads, default={}, metavar="JSON", help="arguments of ENV_ID")
    parser.add_argument("--rate", type=float, metavar="HZ", help="steps a second, if the environment does not tell")
    parser.add_argument("--start-time", type=int, metavar="NS", help="time of the first step [now]")
    parser.add_argument("--chunk-size", type=positive, default=1 << 20, metavar="BYTES", help="of JSON [1 MiB]")
    parser.add_argument("--overwrite", action="store_true", help="replace OUT.mcap if it exists")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    args = arguments(argv)
    try:
        register_atari(args.env_id)
        recorder = record(args)
    except (OSError, TypeError, ValueError, gym.error.Error) as error:
        raise SystemExit(f"record_rollouts.py: {error}") from error
    except KeyboardInterrupt:
        raise SystemExit(f"record_rollouts.py: interrupted; {args.recording} holds the steps up to here") from None
    for episode in sorted(recorder.finished, key=lambda episode: episode.number or 0):
        print(f"episode {episode.number}: {episode.n_steps} steps, return {episode.episode_return:g}")
    print(f"{recorder.path}: {len(recorder.finished)} episodes, {recorder.n_steps} steps")


if __name__ == "__main__":
    main()
