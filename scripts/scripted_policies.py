"""Scripted policies for well-known environments: players good enough that their recordings hold purposeful actions.

Input: an environment made by Gymnasium or ALE. Output: a policy, a function from an observation to an action.
The ALE policies read the positions of ball, players and gates from the RAM, whatever the observation is.

Example: policy = scripted_policy(env); action = policy(observation)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

Policy = Callable[[Any], Any]
Ram = Sequence[int]


def scripted_policy(env: gym.Env) -> Policy:
    """A policy for one episode of `env`: some remember what they saw, so take a new one for each."""
    env_id = env.spec.id if env.spec else ""
    if env_id in CLASSIC_CONTROL:
        return CLASSIC_CONTROL[env_id]
    if env_id in ATARI:
        return AtariPolicy(env, ATARI[env_id]())
    known = ", ".join(sorted(CLASSIC_CONTROL | ATARI))
    raise ValueError(f"no scripted policy for {env_id}; there is one for {known}")


# Classic control ------------------------------------------------------------------------------------------------------


def balance_pole(observation: Sequence[float]) -> int:
    """CartPole: push to the side the pole falls to, with a pull to the middle of the track."""
    position, velocity, angle, angular_velocity = observation
    return int(0.02 * position + 0.1 * velocity + angle + 0.3 * angular_velocity > 0)


def swing_up_car(observation: Sequence[float]) -> int:
    """MountainCar: accelerate the way the car already moves, which adds energy at each swing."""
    _, velocity = observation
    return 2 if velocity >= 0 else 0


def swing_up_pendulum(observation: Sequence[float]) -> np.ndarray:
    """Pendulum: add energy until the rod can reach the top, then hold it there."""
    cos_theta, sin_theta, theta_dot = (float(value) for value in observation)
    theta = math.atan2(sin_theta, cos_theta)
    if cos_theta > 0.85:
        torque = -12.0 * theta - 3.0 * theta_dot
    else:
        # Energy of a rod of mass and length 1, zero when it stands still at the top (g = 10).
        energy = theta_dot**2 / 6 + 5.0 * (cos_theta - 1)
        torque = math.copysign(2.0, -energy * theta_dot if theta_dot else 1.0)
    return np.array([min(max(torque, -2.0), 2.0)], dtype=np.float32)


def swing_up_acrobot(observation: Sequence[float]) -> int:
    """Acrobot: torque with the motion of the second link, which pumps the first one up."""
    theta_dot_1, theta_dot_2 = observation[4], observation[5]
    return 2 if theta_dot_2 - 0.5 * theta_dot_1 > 0 else 0


CLASSIC_CONTROL: dict[str, Policy] = {
    "Acrobot-v1": swing_up_acrobot,
    "CartPole-v1": balance_pole,
    "MountainCar-v0": swing_up_car,
    "Pendulum-v1": swing_up_pendulum,
}


# ALE. A player maps the RAM to the name of a joystick position; addresses are those of the Atari 2600 cartridges. -----


class AtariPolicy:
    """Turns a player's joystick positions into action numbers of `env`, which depend on its action set."""

    def __init__(self, env: gym.Env, player: Callable[[Ram], str]) -> None:
        game: Any = env.unwrapped
        self.ale = game.ale
        self.player = player
        self.numbers = {name: number for number, name in enumerate(game.get_action_meanings())}

    def __call__(self, _observation: Any) -> int:
        # Python integers: differences of the RAM's unsigned bytes would wrap around.
        return self.numbers[self.player(self.ale.getRAM().tolist())]


def joystick(right: int, down: int = 0, fire: bool = False) -> str:
    """Name of a joystick position from two signs and the button."""
    vertical = "DOWN" if down > 0 else "UP" if down < 0 else ""
    horizontal = "RIGHT" if right > 0 else "LEFT" if right < 0 else ""
    return vertical + horizontal + ("FIRE" if fire else "") or "NOOP"


def sign(value: float, dead_band: float = 0) -> int:
    """-1, 0 or 1; 0 within the dead band."""
    return (value > dead_band) - (value < -dead_band)


class PongPlayer:
    """Meets the ball where it will be; RIGHT is up. Each return hits the paddle elsewhere, or rallies never end."""

    AIMS = (-5, -4, -6)

    def __init__(self) -> None:
        self.ball: tuple[int, int] | None = None
        self.approaching = False
        self.n_returns = 0

    def __call__(self, ram: Ram) -> str:
        ball, paddle_y = (ram[49], ram[54]), ram[51]
        before, self.ball = self.ball or ball, ball
        if ball[1] == 0:
            return joystick(0, fire=True)
        approaching = ball[0] > before[0] if ball != before else self.approaching
        self.n_returns += self.approaching and not approaching
        self.approaching = approaching
        lead = 1.5 * (ball[1] - before[1]) if approaching else 0
        aim = self.AIMS[self.n_returns % len(self.AIMS)]
        return joystick(right=-sign(ball[1] + lead + aim - paddle_y, dead_band=11))


class BreakoutPlayer:
    """Serves, then keeps the paddle below where the ball is about to be."""

    def __init__(self) -> None:
        self.ball_x = 0

    def __call__(self, ram: Ram) -> str:
        ball_x, ball_y, paddle_x = ram[99], ram[101], ram[72]
        lead, self.ball_x = ball_x - self.ball_x, ball_x
        if ball_y == 0:
            return joystick(0, fire=True)
        # A jump is a new ball, not a fast one.
        lead = lead if abs(lead) < 16 else 0
        return joystick(right=sign(ball_x + lead - paddle_x - 8, dead_band=5))


class BoxingPlayer:
    """Walks to punching distance beside the opponent, level with its head, and punches."""

    def __init__(self) -> None:
        self.n_steps = 0

    def __call__(self, ram: Ram) -> str:
        self.n_steps += 1
        dx, dy = ram[33] - ram[32], ram[35] - ram[34]
        toward = sign(dx) or 1
        right = toward if abs(dx) > 24 else -toward if abs(dx) < 20 else 0
        # The button is released every other step: it must go down anew for each punch.
        return joystick(right, down=sign(dy, dead_band=14), fire=self.n_steps % 2 == 0)


class TennisPlayer:
    """Follows the ball along its base line and swings; each stroke meets the ball elsewhere, else rallies never end."""

    AIMS = (0, 1, -1)

    def __init__(self) -> None:
        self.ball_y = 0
        self.approaching = False
        self.n_returns = 0

    def __call__(self, ram: Ram) -> str:
        ball_x, ball_y, x, y, opponent_y = ram[16], ram[15], ram[26], ram[24], ram[25]
        # The players change ends.
        at_bottom = y > opponent_y
        approaching = (ball_y > self.ball_y) == at_bottom
        self.n_returns += self.approaching and not approaching
        self.approaching, self.ball_y = approaching, ball_y
        aim = self.AIMS[self.n_returns % len(self.AIMS)]
        home_y = 125 if at_bottom else 30
        return joystick(sign(ball_x + aim - x, dead_band=2), down=sign(home_y - y, dead_band=4), fire=True)


class SkiingPlayer:
    """Steers gently, since turning brakes, to the middle of the next gate."""

    FLAG = 2
    GATE_MIDDLE = 17  # from a gate's left flag
    SKIER_Y = 137  # objects come up from 0
    STRAIGHT_DOWN = 8

    def __call__(self, ram: Ram) -> str:
        x, heading = ram[25], ram[15]
        objects = zip(ram[62:70], ram[70:78], ram[86:94], strict=True)
        gates = [left for left, kind, y in objects if kind == self.FLAG and y < self.SKIER_Y]
        turn = min(max(0.1 * (gates[0] + self.GATE_MIDDLE - x), -3), 3) if gates else 0
        return joystick(right=sign(self.STRAIGHT_DOWN + turn - heading, dead_band=0.5))


ATARI: dict[str, Callable[[], Callable[[Ram], str]]] = {
    "ALE/Boxing-v5": BoxingPlayer,
    "ALE/Breakout-v5": BreakoutPlayer,
    "ALE/Pong-v5": PongPlayer,
    "ALE/Skiing-v5": SkiingPlayer,
    "ALE/Tennis-v5": TennisPlayer,
}
