"""Finder of palm, fingers, tips, thumb or jaws in a hand's description, and of what its file says of them."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from dexgrasp_env.arrays import Array, Fields, middle
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.couplings import couplings, led_by, narrow, share
from dexgrasp_env.robot.description import bearers
from dexgrasp_env.robot.gripper import Jaws, find_jaws
from dexgrasp_env.robot.hulls import cut, hull_of
from dexgrasp_env.robot.part import NamedParts, Part
from dexgrasp_env.robot.rebuilt import FLANGE, about, frame_entry
from dexgrasp_env.robot.source import WRIST, branching, limb

PLATE = 0.0133
"""m between flange and hand."""


def stated(entry: Fields) -> Fields:
    """Leave out what is empty: files do not state it."""
    return {key: value for key, value in entry.items() if value not in ((), [])}


class HandMaker(Part):
    """Finds palm, fingers, tips of a hand's description."""

    def __init__(self, path: Path, named: NamedParts | None = None) -> None:
        """Look at it.

        Raises:
            InputError: for what is no hand of two fingers or more.
        """
        super().__init__(path)
        self.couplings, still, notes = couplings(self.model, path)
        self.notes += notes
        if sprung := self.joint_names(np.flatnonzero(self.model.jnt_stiffness).tolist()):
            self.notes.append(
                f"hand: springs of {', '.join(sprung)} are left out: couplings are rigid, servos hold the others"
            )
        self.named = named or NamedParts()
        self._check_names()
        held = self.joint_ids(still)
        self.still = self.model.jnt_bodyid[held].tolist()
        self.palm = self._find_palm()
        self.chains = self._find_fingers(set(held))
        self.held += still
        reaches = self._reaches()
        self.jaws: Jaws | None = None
        if len(self.chains) < 2:
            raise InputError(f"{path} has {len(self.chains)} fingers: valid are two or more")
        if len(self.chains) - self.linkages < 3:
            self._find_jaws(reaches)
        else:
            self._find_thumb()

    def _find_jaws(self, reaches: Array) -> None:
        """Take the two chains that reach farthest for the jaws of a gripper, and what is behind them for rods."""
        if len(jaws := np.flatnonzero(reaches > 0.95 * reaches.max()).tolist()) != 2:
            raise InputError(
                f"{self.path} has {len(jaws)} jaws that reach alike: valid are two, or driven fingers"
            )
        rods = [chain for k, chain in enumerate(self.chains) if k not in jaws]
        own = [self.chains[k] for k in jaws]
        for joint in self.names(own[0])[1]:
            if {c.follows for c in self.couplings} - {j for chain in own for j in self.names(chain)[1]}:
                self.couplings = led_by(self.couplings, joint)
        opened, closed = self._ends([chain[-1] for chain in own], [*own, *rods])
        self.jaws = jaws_found = find_jaws(self, self.palm, [chain[-1] for chain in own], opened, closed)
        self.opened = 0.9 * opened + 0.1 * closed
        own.sort(key=lambda chain: chain[-1] != jaws_found.ends[0])
        self.chains, self.linkages = [*rods, *own], len(rods)
        self.frame, self.radius = self.jaws.palm, self.jaws.radius
        self._tips = [(self.pose(self.palm), 0.0) for _ in rods] + [(T, self.radius) for T in self.jaws.tips]
        self.notes.append(
            f"hand: a gripper of {1000 * self.jaws.stroke:.0f} mm stroke, pads of {2000 * self.radius:.0f} mm: "
            f"torsion {self.jaws.torsion} m assumed"
        )

    def _ends(self, ends: list[int], chains: list[list[int]]) -> tuple[Array, Array]:
        """Return the places (n,) of all joints with two bodies farthest apart, and nearest to each other."""
        joints = [name for chain in chains for name in self.names(chain)[1]]
        low, high = self.ranges(self.joint_ids(joints)).T.tolist()
        limits = {"lower": low, "upper": high}
        narrow(joints, limits, self.couplings)
        followers = {own.joint for own in self.couplings}
        leading = {n: (a, b) for n, a, b in zip(joints, low, high, strict=True) if n not in followers}
        middle_at = {name: 0.5 * (a + b) for name, (a, b) in leading.items()}
        opened, closed = dict[str, float](), dict[str, float]()
        for name, (a, b) in leading.items():
            wider = self._gap(ends, middle_at | {name: b}) > self._gap(ends, middle_at | {name: a})
            opened[name], closed[name] = (b, a) if wider else (a, b)
        return self._following(opened), self._following(closed)

    def _gap(self, ends: list[int], at: dict[str, float]) -> float:
        self.place(self._following(at))
        return float(np.linalg.norm(np.subtract(*(self.points(body).mean(0) for body in ends))))

    def _following(self, at: dict[str, float]) -> Array:
        """Return the places (n,) of all joints, where leading ones are told theirs."""
        q = np.clip(0.0, *self.ranges().T)
        q[self.joint_ids(at)] = list(at.values())
        for own in self.couplings:
            follower, leader = self.joint_ids((own.joint, own.follows))
            q[follower] = own.offset + own.ratio * q[leader]
        return q

    def _find_thumb(self) -> None:
        """Find the tips, and the thumb among them, which comes last."""
        fingers = self.chains[self.linkages :]
        self.open_drawn(fingers)
        self.straighten(fingers)
        self._tips = [self._tip(chain) for chain in self.chains]
        ways = np.array([np.r_[T[:3, 2], T[:3, 0]] for T, _ in self._tips])
        unlike = (ways @ ways.T)[self.linkages :, self.linkages :].sum(1)
        thumb = self.linkages + int(np.argmin(unlike))  # points and faces least as the others do
        ends = [self.model.body(chain[-1]).name for chain in self.chains]
        if self.named.thumb:
            body = self.model.body(self.named.thumb).id
            named = [any(self.hangs_on(body, own) for own in chain) for chain in self.chains]
            if not any(named):
                raise InputError(
                    f"--thumb {self.named.thumb} is no body of a finger: fingers end in {', '.join(ends)}"
                )
            thumb = named.index(True)
        elif np.diff(np.sort(unlike)[:2]) < 0.5:  # another finger faces nearly as little as the others do
            self.notes.append(
                f"hand thumb: the finger that ends in {ends[thumb]!r} is a guess: --thumb BODY names another"
            )
        self.chains.append(self.chains.pop(thumb))  # the thumb comes last
        self._tips.append(self._tips.pop(thumb))
        self.bases = self.data.xanchor[[self.model.body_jntadr[chain[0]] for chain in self.chains]]
        self.radius = float(np.round(min(radius for _, radius in self._tips), 4))
        self.frame = self._claw_frame(self._palm_frame())

    def _check_names(self) -> None:
        """Refuse names of no body."""
        known = [self.model.body(b).name for b in range(1, self.model.nbody)]
        for name in filter(None, (self.named.palm, self.named.thumb, *self.named.flip)):
            if name not in known:
                raise unknown_name("body", name, known)

    def _reaches(self) -> Array:
        """Return how far chains reach (n,) m.

        Raises:
            InputError: for limbs, as legs and arms branch as fingers do, and lengths in other units than metres.
        """
        at = self.pose(self.palm)[:3, 3]
        found = np.array([np.linalg.norm(self.outline(c[-1]) - at, axis=1).max() for c in self.chains])
        if len(found) and not 0.02 < found.max() < 0.45:  # m
            palm = f"{self._name(self.palm)} reaches {found.max():.2f} m: no hand does (--palm BODY takes another)"
            raise InputError(f"{self.path}: what branches from {palm}")
        return found

    def _find_palm(self) -> int:
        """Return the body that bears the fingers: the one that the user names, or the first that branches."""
        body = self.model.body(self.named.palm).id if self.named.palm else self._only_palm()
        self.held = self.names([b for b in bearers(self.model, body)[::-1] if self.model.body_jntnum[b]])[1]
        if len(limb(self.model, body)) > WRIST:
            self.notes.append(f"the arm in the file ends at {self._name(body)}, which bears the hand")
            self.held = []
        if self.held:
            self.notes.append(
                f"hand held: {', '.join(self.held)}, before the palm, stand still at 0; --palm BODY if another is it"
            )
        return body

    def _only_palm(self) -> int:
        """Return the first body that branches, unless what goes out from it are hands themselves."""
        body = branching(self.model)
        further = [branching(self.model, b) for b in self.below(body)]
        palms = [b for b in further if len(self.below(b)) > 1]
        many = [b for b in palms if len(self.below(b)) > 2]
        if len(many) > 1 or 1 < len(palms) == len(further):
            names = ", ".join(map(self._name, palms))
            raise InputError(f"{self.path} has several hands, on {names}: --palm BODY takes one")
        return body

    def _find_fingers(self, still: set[int]) -> list[list[int]]:
        """Return the chains of jointed bodies from the palm out; joints before a branching are held at 0.

        Bodies of `still` joints are no part of a chain.
        """
        found, left, held = list[list[int]](), self.below(self.palm), set[int]()
        while left:
            body = left.pop(0)
            if not self.model.body_jntnum[body]:  # a plate on the palm
                left = self.below(body) + left
                continue
            chain = self.chain(body)
            if more := self.below(chain[-1]):
                held |= set(self.model.body_jntadr[chain].tolist())
                left = more + left
            else:
                found.append(chain)
        pairs = [self.joint_ids((own.joint, own.follows)) for own in self.couplings]
        held |= {follower for follower, leader in pairs if leader in held}
        if held:
            joints = sorted(self.joint_names(held))
            self.notes.append(
                f"hand held: {', '.join(joints)}, which several fingers share, stand still at 0"
            )
            self.held += joints
            self.couplings = [own for own in self.couplings if own.joint not in joints]
        followers = {own.joint for own in self.couplings}
        chains = [[b for b in chain if self.model.body_jntadr[b] not in held | still] for chain in found]
        own = [set(self.names(chain)[1]) for chain in chains]
        linkages = [k for k, joints in enumerate(own) if joints and joints <= followers]
        self.linkages = len(linkages)  # chains that only follow: rods of a finger
        return [chains[k] for k in linkages] + [
            chain for k, chain in enumerate(chains) if k not in linkages and chain
        ]

    def _flexing(self, chain: list[int], way: Array) -> Array:
        """Return the axis (3,) about which a finger bends by its last joint, the finger pointing along `way`."""
        joints, senses = self.bending(chain)
        axis, anchor = self.data.xaxis[joints[-1]], self.data.xanchor[joints[-1]]
        for joint, sense in zip(joints[::-1], senses[::-1], strict=True):
            low, high = np.sort(sense * (self.ranges([joint])[0] - self.data.qpos[joint]))
            if abs(high + low) >= 0.2 * (high - low):
                return axis if high > -low else -axis
        # All bend as far to either side: towards what is between the fingers, or away from the palm.
        name, pad = self.model.body(chain[-1]).name, np.cross(axis, way / np.linalg.norm(way))
        self.notes.append(f"hand pads: which side of {name!r} is the pad is a guess: --flip {name} turns it")
        last = self.model.body_jntadr[[chain[-1] for chain in self.chains[self.linkages :]]]
        for towards in (self.data.xanchor[last].mean(0) - anchor, anchor - middle(self.outline(self.palm))):
            if abs(towards @ pad) > 0.3 * np.linalg.norm(towards):
                return axis * np.sign(towards @ pad)
        return -axis

    def _tip(self, chain: list[int]) -> tuple[Array, float]:
        """Frame (4, 4) at the end of a chain, its origin on the surface of the pad, and the radius m of its tip."""
        j = self.model.body_jntadr[chain[-1]]
        axis, anchor = self.data.xaxis[j], self.data.xanchor[j]
        points, radius = hull_of(self.points(chain[-1]))[0] - anchor, 0.01
        along = points - np.outer(points @ axis, axis)
        way = along[np.argmax(np.linalg.norm(along, axis=1))]
        flexing = self._flexing(chain, way)
        if self.model.body(chain[-1]).name in self.named.flip:
            flexing = -flexing
        for _ in range(10):  # the section at the sphere's middle says where the tip is, and how wide
            T = about(anchor, way / np.linalg.norm(way), np.cross(flexing, way))
            local = points @ T[:3, :3]
            top = local[:, 2].max()
            above, _ = cut(local, top - radius)
            section = above[np.abs(above[:, 2] - (top - radius)) < 1e-9][:, :2]
            radius = np.clip(0.5 * np.ptp(section, axis=0).min(), 0.005, 0.02)
            x, y = middle(section)
            way = T[:3, :3] @ [x, 0.0, top - radius]
        T[:3, 3] += T[:3, :3] @ [section[:, 0].max(), y, top]
        return T, radius

    def tip(self, k: int) -> Array:
        """Return the frame (4, 4) of a finger's tip, its origin at the middle of the sphere."""
        T = self._tips[k][0].copy()
        if self.jaws:
            return T
        T[:3, 3] -= self.radius * (T[:3, 0] + T[:3, 2])
        return T

    def _palm_frame(self) -> Array:
        others = [T for T, _ in self._tips[self.linkages : -1]]
        z = np.mean([T[:3, 2] for T in others], axis=0)
        T = about(np.zeros(3), z / np.linalg.norm(z), np.mean([T[:3, 0] for T in others], axis=0))
        pads = [(t[:3, 3] - radius * t[:3, 0]) @ T[:3, 0] for t, radius in self._tips[self.linkages : -1]]
        depth, base = np.mean(pads), self.bases[self.linkages : -1].mean(0)
        T[:3, 3] = base + (depth - base @ T[:3, 0]) * T[:3, 0]
        return T

    def _claw_frame(self, T: Array) -> Array:
        """Return the palm frame (4, 4) of a claw, whose thumb swings against the others in one plane; or a hand's, T.

        In that plane a claw approaches square to the way from the thumb to the others, away from the palm.
        """
        near = self._beside_thumb()
        tips, thumb = np.mean([self._tips[k][0] for k in near], axis=0), self._tips[-1][0]
        turns = [np.cross(own[:3, 0], own[:3, 2]) for own in (tips, thumb)]
        turn = turns[0] / np.linalg.norm(turns[0])
        bases = self.data.xanchor[[self.bending(self.chains[k])[0][0] for k in (*near, -1)]]
        across = bases[:-1].mean(0) - bases[-1]
        across -= across @ turn * turn
        x = np.cross(turn, across / np.linalg.norm(across))
        x *= np.sign(x @ (0.5 * (tips + thumb)[:3, 3] - middle(self.outline(self.palm))))
        if turn @ turns[1] > -0.8 or x @ T[:3, 0] > 0.8:
            return T
        return about(bases.mean(0), across / np.linalg.norm(across), x)

    def entry(self) -> Fields:
        """Return what the hand's file says."""
        near = [] if self.jaws else self._beside_thumb()
        names = [*(f"finger_{k + 1}" for k in range(len(self.chains) - 1)), "thumb"]
        if self.jaws:
            names = [*(f"rod_{k + 1}" for k in range(self.linkages)), "left", "right"]
        fingers, joints = [], list[str]()
        for k, chain in enumerate(self.chains):
            bodies, own = self.names(chain)
            joints += own
            idle = not self.jaws and self.linkages <= k and k not in near and names[k] != "thumb"
            fingers.append(stated({
                "name": names[k], "joints": own, "bodies": bodies, "tip": f"{names[k]}_tip",
                "frame": frame_entry(self.pose(chain[-1]), self.tip(k)),
                "aside": self._tucked(k, self.bases[near].mean(0)) if idle else (),
            }))  # fmt: skip
        # How far the last links reach back from their ends, m.
        lengths = [np.ptp(self.points(chain[-1]) @ self.tip(k)[:3, 2]) for k, chain in enumerate(self.chains)]
        return stated({
            **self.head(), "palm": self.model.body(self.palm).name,
            "frame": frame_entry(self.pose(self.palm), self.frame), "tip_radius": self.radius,
            # Fingers with narrow tips touch with all of their last links.
            "tip_length": float(np.round(max(lengths), 4)) if self.radius < 0.008 and not self.jaws else (),
            "torsion": self.jaws.torsion if self.jaws else (),
            **self._driven(joints), "held": self.held,
            "fingers": fingers, "grasp": names[-2:] if self.jaws else ["thumb", *(names[k] for k in near)],
            "mounts": {"palm_normal": self._mount()},
        })  # fmt: skip

    def _tucked(self, k: int, others: Array) -> list[float]:
        """Return the posture (n,) rad of an idle finger: straight, spread away from the bases of the others (3,) m."""
        joints = self.model.body_jntadr[self.chains[k]]
        low, high = self.ranges(joints).T
        away = self.data.xanchor[joints[0]] - others
        away -= away @ self.frame[:3, 2] * self.frame[:3, 2]
        moves = np.cross(self.data.xaxis[joints], self.tip(k)[:3, 3] - self.data.xanchor[joints]) @ away
        moves /= np.linalg.norm(away)
        straight, spreads = self.data.qpos[joints].copy(), int(np.argmax(np.abs(moves)))
        straight[spreads] += np.sign(moves[spreads]) * 0.4  # rad
        return np.clip(straight, low, high).round(6).tolist()

    def _driven(self, joints: list[str]) -> Fields:
        """Return limits, gains and tendons as the file says them."""
        limits = self.limits(joints, "gripper" if self.jaws else "hand")
        tendons: list[Fields] = [
            {
                "joints": self.joint_names(own),
                "coefs": [coef / own[max(own)] for coef in own.values()],
            }
            for own in self.tendons().values()
        ]
        curled = 0.8  # rad: farther curled, a tendon pulls the other joints off their stops
        for tendon in tendons:
            last = joints.index(tendon["joints"][-1])
            limits["upper"][last] = min(limits["upper"][last], curled)
        narrow(joints, limits, self.couplings)
        if tendons:
            self.notes.append(f"hand upper: last joints of tendons end at {curled} rad")
        if self.couplings:
            pairs = ", ".join(f"{own.joint} = {own.ratio:.4g} {own.follows}" for own in self.couplings)
            self.notes.append(f"hand couplings: {pairs}")
        if self.jaws:
            share(joints, limits["torque"], self.couplings)
        followers = [asdict(own) for own in self.couplings if own.joint in joints]
        return limits | {"couplings": followers, "tendons": tendons}

    def _beside_thumb(self) -> list[int]:
        """Return the finger whose base is nearest to the thumb's tip, and the neighbour of it whose base is nearer."""
        bases = self.data.xanchor[[self.bending(chain)[0][0] for chain in self.chains[:-1]]]
        thumb = self._tips[-1][0]
        away = np.linalg.norm(bases - thumb[:3, 3], axis=1)
        near = [k for k in np.argsort(away, kind="stable").tolist() if k >= self.linkages]
        # These do not oppose it.
        beside = [k for k in near if (self._tips[k][0] * thumb)[:3, ::2].sum() > 1.5]
        near = [k for k in near if k not in beside] if len(near) > len(beside) + 1 else near
        tips = [self.tip(k)[:3, 3] for k in near]
        beside = [round(float(np.linalg.norm(tip - tips[0])), 2) for tip in tips]
        return [near[k] for k in np.argsort(beside, kind="stable")[:2]]

    def _mount(self) -> dict[str, list[float]]:
        """The back of the hand on the flange, the palm's middle on the flange's axis."""
        solids = [
            (self.outline(b) - self.frame[:3, 3]) @ self.frame[:3, :3]
            for b in (self.palm, *(b for chain in self.chains for b in chain[:2]))
            if self.solids(b) or b == self.palm
        ]
        back = min(points[:, 0].min() for points in solids)
        _, y, z = middle(solids[0])
        # x of the palm along the flange, its z along the last link's x.
        quat = [0.0, 0.5**0.5, 0.0, 0.5**0.5]
        return {"position": np.round([-z, y, FLANGE + PLATE - back], 6).tolist(), "quat_wxyz": quat}
