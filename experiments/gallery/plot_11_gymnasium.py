"""
A Gymnasium environment and a policy
====================================

One step is one move; the action is a shaper; the payload changes and nobody says so. The policy that comes with jshape
has learned to infer the payload from what the last move left.
"""

import gymnasium as gym
import jax
import jshape_envs
import matplotlib.pyplot as plt
import numpy as np

jax.config.update("jax_enable_x64", True)

env = gym.make("jshape_envs:jshape/DuffingPayload-v0", preset="paper", context="hidden", render_mode="rgb_array")
policy = jshape_envs.load_policy("DuffingPayload")
params = jshape_envs.parameters("DuffingPayload")
act = jax.jit(lambda memory, observation: policy.act(memory, observation))


def episode(learned: bool, moves: int = 24) -> np.ndarray:
    """The residual energy of each move, a fraction of what the bare move leaves."""
    observation, _ = env.reset(seed=3)
    memory, left = policy.init(params), []
    for _ in range(moves):
        memory, action = act(memory, observation)
        chosen = np.asarray(action) if learned else np.zeros(env.action_space.shape, np.float32)
        observation, _, _, _, info = env.step(chosen)
        left.append(info["residual"])
    return np.array(left)


# %%
# The same moves with the middle of all shapers, and with the policy.
left = {"action 0": episode(False), "policy": episode(True)}
for name, values in left.items():
    mean, most = 100 * values.mean(), 100 * values.max()
    print(f"{name}: residual energy {mean:.2f} % of the bare move's on average, at most {most:.2f} %")

# %%
# The last move of the policy's episode, as the environment draws it.
picture = env.render()
figure, axis = plt.subplots(figsize=(6.4, 4.8))
axis.imshow(picture)
axis.set_axis_off()
env.close()
