"""Rigid fine-tuning: move and turn every box until the surface passes through its middle.

Both solvers treat all boxes at once in torch. The nearest point of each sample is looked up outside of torch
and held fixed while the gradient is taken; by the envelope theorem that *is* the gradient of the distance to
the surface. Boxes turn about their own centroid (the paper's Eqs. 6-7).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core import process
from core.arrays import Bool, Float
from core.geometry.boxes import Boxes, unit_grid
from core.geometry.products import cross
from core.geometry.sampling import thin
from core.geometry.spatial import SpatialIndex
from core.placement.nearest import Nearest, of_surface

process.after_torch()

LOSS_POINTS = 179  # points of a box's outline; the paper's J, supplement "Implementation Details"
DIGITS = 7  # decimals of the positions, directions and squared distances of a fit


@dataclass(frozen=True)
class AdamOptions:
    """Values of :func:`adam`.

    Attributes:
        steps: at most. Paper, supplement "Implementation Details".
        threshold: squared size-30 units; loss of a well-aligned box, at most. Paper, supplement "Filtering".
        rate: learning rate. Ours; the paper gives none. Boxes below the threshold after at most 200 steps, of 231 on
            its elephant and 153 on its shark: 21 and 69 at 0.005, 48 and 92 at 0.01, 73 and 110 at 0.02, 97 and 117 at
            0.05, 108 and 122 at 0.1. Beyond that the gain is small and boxes move two units and more from their
            samples.
    """

    steps: int = 200
    threshold: float = 0.005
    rate: float = 0.1


ADAM = AdamOptions()


@dataclass(frozen=True)
class Pass:
    """One pass of :func:`levenberg_marquardt`.

    Attributes:
        grid: points along the text and across it at which the distance to the surface is taken.
        steps: at most.
        slack: squared size-30 units; excess of the mean squared distance over the limit after the pass, at most: boxes
            of more are rejected.
    """

    grid: tuple[int, int]
    steps: int
    slack: float


@dataclass(frozen=True)
class LevenbergMarquardtOptions:
    """Values of :func:`levenberg_marquardt`: all ours, but for the threshold.

    Attributes:
        threshold: squared size-30 units; loss of a well-aligned box, at most. Paper, see :class:`AdamOptions`.
        bend: share of the longer side; root mean square distance that is well aligned too: on a ball of radius 7, a
            rump or a head, text may be 4.9 wide then, where the paper's threshold allows 3.4. On 33 assets uncoloured
            text is read better than with less (0.02) and as well as with more (0.04).
        coarse: first pass. Of the boxes that end well aligned, all but about one in twenty-five are below its slack.
        fine: second pass; all but one in a hundred are below its slack.
        exact: last pass, after boxes were recentred on their support.
        every: one in so many of the outline's points gives the loss at the end.
        copy: tolerance of :func:`distinct` after the coarse pass: closer boxes end as copies of one another.
        roll_weight: loss limits; weight of the squared sine of the roll against the mean squared distance: enough to
            keep text upright where the surface allows it, and on a saddle, which is straight along its diagonals only;
            too little to hold a box off the surface.
        damping: of the first step, in shares of the matrix's diagonal.
        damping_factor: by which a failed step raises the damping, and a successful one lowers it.
        converged: relative decrease of the cost, below which a box has converged.
        negligible: squared size-30 units; cost below which a box has converged.
        longest_move: size-30 units in one step.
        largest_turn: radians in one step.
    """

    threshold: float = ADAM.threshold
    bend: float = 0.03
    coarse: Pass = Pass(grid=(8, 2), steps=8, slack=0.025)
    fine: Pass = Pass(grid=(12, 3), steps=6, slack=0.015)
    exact: Pass = Pass(grid=(10, 3), steps=2, slack=0.005)
    every: int = 3
    copy: float = 0.06
    roll_weight: float = 3.0
    damping: float = 1e-2
    damping_factor: float = 4.0
    converged: float = 0.01
    negligible: float = 1e-6
    longest_move: float = 1.0
    largest_turn: float = 0.5


LEVENBERG_MARQUARDT = LevenbergMarquardtOptions()


def loss_limit(size: Float, options: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT) -> Float:
    """(B,) the :func:`alignment_loss`, squared size-30 units, below which boxes of each ``size`` (B, 3) are well
    aligned: the paper's, or more for long text, which may follow a body round."""
    return np.asarray(np.maximum((options.bend * _longest(size)) ** 2, options.threshold))


def _longest(size: Float) -> Float:
    """(B,) the longer side of the text in boxes of each ``size`` (B, 3)."""
    return np.asarray(size[:, :2].max(axis=1))


def perimeter(size: Float) -> Float:
    """(B, 179, 3) points, in box coordinates, along the outline of the middle plane of boxes of ``size`` (B, 3).

    Each side starts at its corner and is divided evenly; sides share the points by their length, so that
    spacing is the same all round up to rounding (the paper's Eq. 9).
    """
    ratio = size[:, 0] / (size[:, 0] + size[:, 1])
    unit = np.empty((len(size), LOSS_POINTS, 2))
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    for value in np.unique(ratio):
        long = int(np.clip(round(LOSS_POINTS * value / 2), 1, LOSS_POINTS // 2 - 1))
        counts = (long, LOSS_POINTS // 2 - long, long, LOSS_POINTS - LOSS_POINTS // 2 - long)
        sides = [
            start + (end - start) * (np.arange(count) / count)[:, None]
            for start, end, count in zip(corners[:-1], corners[1:], counts, strict=True)
        ]
        unit[ratio == value] = np.concatenate(sides)
    return np.concatenate([unit * size[:, None, :2], np.zeros((len(size), LOSS_POINTS, 1))], axis=2)


def alignment_loss(boxes: Boxes, index: SpatialIndex) -> Float:
    """(B,) mean squared distance, squared size-30 units, of each box's 179 outline points to the surface."""
    return _outline_loss(boxes, of_surface(index), every=1)


def _outline_loss(boxes: Boxes, nearest: Nearest, every: int) -> Float:
    """The same for the ``nearest`` points of a surface, and for one in ``every`` so many of the outline's points."""
    points = np.einsum("bpi,bij->bpj", perimeter(boxes.size)[:, ::every], boxes.axes) + boxes.center[:, None, :]
    offset = points - nearest(points, boxes.axes[:, 2] * boxes.size[:, 2:] / 2)
    return np.asarray((offset**2).sum(axis=2).mean(axis=1))


Recentre = Callable[[Boxes], tuple[Boxes, Bool]]


def levenberg_marquardt(
    boxes: Boxes,
    nearest: Nearest,
    device: torch.device,
    keep: Callable[[Boxes], Bool] | None = None,
    recentre: Recentre | None = None,
    options: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT,
) -> tuple[Boxes, Float]:
    """Fit all boxes by batched Levenberg-Marquardt, coarse to fine.

    The residuals are signed distances of a grid over the whole middle plane, so that the surface is met under
    the letters too, not only under the outline.

    Args:
        boxes: to start from.
        nearest: the nearest points on the surface.
        device: that all else happens on.
        keep: (B,) the boxes to keep after the coarse pass, given these; all of them if None.
        recentre: see :func:`correct`.
        options: tuned values.

    Returns:
        the fitted boxes, and their :func:`alignment_loss` (B,), by every third point; inf where a box was rejected: it
        stayed too far from the surface, came close to a better one, or was not kept by ``keep`` or ``recentre``.
    """
    center, axes, rough = _fit(boxes, nearest, device, options.coarse, options)
    loss, limit = np.full(len(boxes), np.inf), loss_limit(boxes.size, options)
    active = np.flatnonzero(rough < limit + options.coarse.slack)
    coarse = Boxes(center, axes, boxes.size)
    if len(active):
        active = active[distinct(coarse[active], rough[active], options.copy)]
        active = active[keep(coarse[active])] if keep else active
        up = boxes.axes[active, 1]
        center[active], axes[active], fine = _fit(coarse[active], nearest, device, options.fine, options, up)
        near = fine < limit[active] + options.fine.slack
        active = active[near]
        fitted, loss[active] = correct(
            Boxes(center, axes, boxes.size)[active], nearest, device, recentre, up[near], options
        )
        center[active], axes[active] = fitted.center, fitted.axes
    return Boxes(center, axes, boxes.size), loss


def correct(
    boxes: Boxes,
    nearest: Nearest,
    device: torch.device,
    recentre: Recentre | None,
    up: Float | None = None,
    options: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT,
) -> tuple[Boxes, Float]:
    """The last pass, for boxes that are nearly aligned.

    Args:
        boxes: to start from.
        nearest: the nearest points on the surface.
        device: that all else happens on.
        recentre: recentres boxes on their support, and returns (B,) those to keep; all as they are if None.
        up: (B, 3) up direction of the roll prior; the boxes' own if None.
        options: tuned values.

    Returns:
        as :func:`levenberg_marquardt`.
    """
    recentred, kept = recentre(boxes) if recentre else (boxes, np.ones(len(boxes), dtype=bool))
    center, axes, loss = recentred.center.copy(), recentred.axes.copy(), np.full(len(boxes), np.inf)
    active = np.flatnonzero(kept)
    if len(active):
        center[active], axes[active], squared = _fit(
            recentred[active],
            nearest,
            device,
            options.exact,
            options,
            boxes.axes[active, 1] if up is None else up[active],
        )
        active = active[squared < loss_limit(boxes.size[active], options) + options.exact.slack]
        loss[active] = _outline_loss(Boxes(center, axes, boxes.size)[active], nearest, options.every)
    return Boxes(center, axes, boxes.size), loss


def distinct(boxes: Boxes, loss: Float, copy: float) -> NDArray[np.int64]:
    """Indices, in ascending order, of the boxes that are left when near copies of better ones are dropped.

    Fitting moves many candidates to the same place. Copies are within ``copy`` times the longer side, turned by as many
    radians, longer by that share, or a combination; the one with the lowest loss stays.
    """
    length = _longest(boxes.size)[:, None]
    pose = np.concatenate([boxes.center / length, boxes.axes[:, 0], boxes.axes[:, 2], np.log(length)], axis=1)
    best_first = np.argsort(loss, kind="stable")
    return np.sort(best_first[thin(pose[best_first], copy)])


def _fit(
    boxes: Boxes,
    nearest: Nearest,
    device: torch.device,
    stage: Pass,
    options: LevenbergMarquardtOptions,
    reference: Float | None = None,
) -> tuple[Float, Float, Float]:
    """Damped Gauss-Newton steps per box, of one ``stage``; centres, axes, mean squared distance.

    All but the look-up of ``nearest`` points happens on ``device``.
    ``reference`` (B, 3) is the up direction of the roll prior; the boxes' own if None.
    """
    unit = torch.tensor(np.pad(unit_grid(stage.grid), ((0, 0), (0, 1))), device=device)
    local = unit[None] * torch.tensor(boxes.size, device=device)[:, None, :]
    up = torch.tensor(boxes.axes[:, 1] if reference is None else reference, device=device)
    center, axes = torch.tensor(boxes.center, device=device), torch.tensor(boxes.axes, device=device)
    weight = torch.tensor(options.roll_weight * loss_limit(boxes.size, options), device=device)
    damping = torch.full((len(boxes),), options.damping, dtype=torch.float64, device=device)
    half = torch.tensor(boxes.size[:, 2:] / 2, device=device)
    squared, cost, hessian, gradient = _linearise(center, axes, local, up, weight, half, nearest)
    going = torch.arange(len(boxes), device=device)
    for _ in range(stage.steps):
        scale = torch.diagonal(hessian[going], dim1=1, dim2=2) + 1e-3
        damped = hessian[going] + torch.diag_embed(damping[going, None] * scale)
        step = -torch.linalg.solve(damped, gradient[going])
        moved = center[going] + _clamp(step[:, :3], options.longest_move)
        turned = axes[going] @ _rotation(_clamp(step[:, 3:], options.largest_turn)).transpose(1, 2)
        trial = _linearise(moved, turned, local[going], up[going], weight[going], half[going], nearest)
        decrease = cost[going] - trial[1]
        better = decrease > 0
        # A box whose last step gained next to nothing has converged; its distances need no further queries.
        arrived = (better & (decrease < options.converged * cost[going])) | (trial[1] < options.negligible)
        factor = options.damping_factor
        damping[going] = torch.where(better, damping[going] / factor, damping[going] * factor).clamp(1e-6, 1e4)
        taken = going[better]
        center[taken], axes[taken] = moved[better], turned[better]
        for kept, new in zip((squared, cost, hessian, gradient), trial, strict=True):
            kept[taken] = new[better]
        going = going[~arrived]
        if len(going) == 0:
            break
    return _even(center.numpy(force=True), axes.numpy(force=True), squared.numpy(force=True))


def _even(center: Float, axes: Float, squared: Float) -> tuple[Float, Float, Float]:
    """The result of a fit without its last digits, which differ from one kind of processor to another; axes (B, 3, 3)
    orthonormalised again."""
    right, normal = np.round(axes[:, 0], DIGITS), np.round(axes[:, 2], DIGITS)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    right -= np.einsum("bi,bi->b", right, normal)[:, None] * normal
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    level = np.stack([right, cross(normal, right), normal], axis=1)
    return np.round(center, DIGITS), level, np.round(squared, DIGITS)


def _linearise(
    center: Tensor, axes: Tensor, local: Tensor, up: Tensor, weight: Tensor, half: Tensor, nearest: Nearest
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Mean squared distance (B,), cost with the roll prior of ``weight`` (B,), Gauss-Newton matrix (B, 6, 6), gradient
    (B, 6); boxes are twice ``half`` (B, 1) thick."""
    arm = local @ axes
    points = arm + center[:, None, :]
    met = nearest(points.numpy(force=True), (axes[:, 2] * half).numpy(force=True))
    offset = points - torch.from_numpy(met).to(points.device)
    length = offset.norm(dim=-1)
    # The sign only makes the residual smooth through zero; at zero the direction is the box's normal.
    normal = axes[:, 2:3, :].expand_as(points)
    sign = torch.where((offset * normal).sum(-1) < 0, -1.0, 1.0)
    touching = length < 1e-9
    direction = torch.where(touching[..., None], normal, offset * (sign / length.clamp(min=1e-9))[..., None])
    residual = sign * length
    jacobian = torch.cat([direction, torch.linalg.cross(arm, direction)], dim=-1)
    count = points.shape[1]
    hessian = jacobian.transpose(1, 2) @ jacobian / count
    gradient = (jacobian * residual[..., None]).sum(1) / count
    squared = residual.square().mean(1)
    # The prior: right . up is the sine of the roll, its derivative by a turn is right x up.
    right = axes[:, 0]
    roll = (right * up).sum(-1)
    slope = torch.linalg.cross(right, up)
    hessian[:, 3:, 3:] += weight[:, None, None] * slope[:, :, None] * slope[:, None, :]
    gradient[:, 3:] += (weight * roll)[:, None] * slope
    return squared, squared + weight * roll.square(), hessian, gradient


def _clamp(step: Tensor, longest: float) -> Tensor:
    factor: Tensor = longest / step.norm(dim=1, keepdim=True).clamp(min=longest)
    return step * factor


def _rotation(turn: Tensor) -> Tensor:
    """(B, 3, 3) rotation matrices of rotation vectors (B, 3), differentiable."""
    zero = torch.zeros_like(turn[:, 0])
    x, y, z = turn.unbind(1)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
    rotation: Tensor = torch.linalg.matrix_exp(skew)
    return rotation


def adam(
    boxes: Boxes,
    index: SpatialIndex,
    progress: Callable[[float], None] = lambda _: None,
    options: AdamOptions = ADAM,
) -> tuple[Boxes, Float]:
    """Fit all boxes as the paper does: up to 200 Adam steps on Eqs. 8-9.

    A box stops at the first step at which its own loss is below 0.005 (the paper stops all boxes on the mean,
    which over-turns the good ones). Returns the boxes and their :func:`alignment_loss` (B,).
    """
    local = torch.from_numpy(perimeter(boxes.size))
    start, axes = torch.from_numpy(boxes.center), torch.from_numpy(boxes.axes)
    pose = torch.zeros((len(boxes), 6), dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([pose], lr=options.rate)
    loss = np.full(len(boxes), np.inf)
    active = torch.arange(len(boxes))
    for step in range(options.steps + 1):
        turned = axes[active] @ _rotation(pose[active, 3:]).transpose(1, 2)
        points = local[active] @ turned + (start[active] + pose[active, :3])[:, None, :]
        _, _, nearest = index.closest(points.detach().numpy().reshape(-1, 3))
        each = (points - torch.from_numpy(nearest).reshape(points.shape)).square().sum(-1).mean(1)
        loss[active.numpy()] = each.detach().numpy()
        going = each.detach() >= options.threshold
        progress(step / options.steps)
        if step == options.steps or not going.any():
            break
        frozen = pose.detach().clone()
        optimizer.zero_grad()
        each[going].sum().backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        active = active[going]
        with torch.no_grad():  # Adam's momentum must not move a box that has stopped
            frozen[active] = pose[active]
            pose.copy_(frozen)
    final = pose.detach()
    fitted = Boxes((start + final[:, :3]).numpy(), (axes @ _rotation(final[:, 3:]).transpose(1, 2)).numpy(), boxes.size)
    return fitted, loss
