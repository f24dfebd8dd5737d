"""Small vibrations by MuJoCo: its masses, and differences of its forces about a rest state."""

import numpy as np

STEP = 2e-6


class Vibrating:
    """A model with dead forces at its site `tip`."""

    def __init__(self, mujoco, xml, dead=(0.0, 0.0, 0.0)):
        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.dead = np.asarray(dead, float)
        self.site = self.model.site("tip").id
        self.body = int(self.model.site_bodyid[self.site])

    def _at(self, q, step):
        moved = q.copy()
        self.mujoco.mj_integratePos(self.model, moved, step, 1.0)
        self.data.qpos[:], self.data.qvel[:] = moved, 0.0
        self.mujoco.mj_forward(self.model, self.data)

    def forces(self, q, step):
        """Generalised forces of all but the constraints, and the constraints' Jacobian."""
        self._at(q, step)
        total = self.data.qfrc_passive - self.data.qfrc_bias
        at = self.data.site_xpos[self.site]
        self.mujoco.mj_applyFT(self.model, self.data, self.dead, np.zeros(3), at, self.body, total)
        J = self.data.efc_J.reshape(-1, self.model.nv)[: self.data.ne].copy()
        return total, J

    def squares(self, q):
        """omega^2 about q, and what nothing balances there over the weights."""
        nv = self.model.nv
        force, J = self.forces(q, np.zeros(nv))
        lam = np.linalg.lstsq(J.T, -force, rcond=1e-10)[0] if len(J) else np.zeros(0)
        left = np.abs(force + J.T @ lam).max() / np.abs(self.data.qfrc_bias).max()
        mass = np.zeros((nv, nv))
        for column, e in zip(mass, np.eye(nv), strict=True):
            self.mujoco.mj_mulM(self.model, self.data, column, e)
        _, values, rows = np.linalg.svd(J) if len(J) else (None, np.zeros(0), np.eye(nv))
        rank = int(np.sum(values > 1e-9 * max(values.max(initial=0.0), 1e-300)))
        N = rows[rank:].T
        K = np.empty((nv, N.shape[1]))
        for i, column in enumerate(N.T):
            ends = []
            for sign in (1.0, -1.0):
                f, A = self.forces(q, sign * STEP * column)
                ends.append(f + A.T @ lam)
            K[:, i] = -(ends[0] - ends[1]) / (2 * STEP)
        K = N.T @ K
        found = np.linalg.eigvals(np.linalg.solve(N.T @ mass @ N, 0.5 * (K + K.T)))
        return np.sort(found.real), float(left)
