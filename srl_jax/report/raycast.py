"""A picture of a MuJoCo state without OpenGL: boxes and capsules on a chequered floor, by ray casting.

Each geom is tested only against the pixels about it, so a frame takes about a tenth of a second.
"""

import mujoco
import numpy as np

SAMPLES = 2  # rays per pixel in each direction
SUN = np.array([-0.3, -0.4, 1.0]) / np.linalg.norm([0.3, 0.4, 1.0])  # towards the light
TILE = 0.25  # m
GREY, HAZE = np.array([0.985, 1.0, 1.015], np.float32), np.array([0.88, 0.90, 0.93], np.float32)
LIGHT, DARK = 0.81, 0.735  # brightness of the two kinds of tile
SHADE = 0.62  # brightness of the floor in shadow
AMBIENT, DIFFUSE = 0.55, 0.60

BOX, SPHERE, CAPSULE = (int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("BOX", "SPHERE", "CAPSULE"))
USED = {BOX: (1, 1, 1), SPHERE: (1, 0, 0), CAPSULE: (1, 1, 0)}  # entries of geom_size that mean something

Geom = tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # type, size, centre, frame, colour
Goal = tuple[np.ndarray, float, tuple[float, float, float]]  # position f[2], radius (m), colour


class Camera:
    """Perspective of a camera of the model: rays of pixels, and pixels of points."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, name: str, size: tuple[int, int]) -> None:
        camera = model.camera(name).id
        self.origin, self.frame = data.cam_xpos[camera].copy(), data.cam_xmat[camera].reshape(3, 3).copy()
        self.width, self.height = size
        self.focal = 0.5 * self.height / np.tan(0.5 * np.deg2rad(model.cam_fovy[camera]))
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal
        y = (0.5 * self.height - np.arange(self.height) - 0.5) / self.focal
        plane = np.stack([*np.meshgrid(x, y), np.full((self.height, self.width), -1.0)])
        self.rays = _turn(self.frame, plane.astype(np.float32))  # [3, H, W], of unit depth: a parameter is a depth

    def window(self, centre: np.ndarray, radius: float) -> tuple[slice, slice]:
        """Rows and columns that the image of a sphere lies in; none where the sphere reaches the camera."""
        local = self.frame.T @ (centre - self.origin)
        depth = -local[2] - radius
        if depth <= 0:
            return slice(0, 0), slice(0, 0)
        reach = self.focal * radius / depth + 2
        column = 0.5 * self.width + self.focal * local[0] / -local[2]
        row = 0.5 * self.height - self.focal * local[1] / -local[2]
        first = np.clip([row - reach, column - reach], 0, None).astype(int)
        last = np.clip([row + reach, column + reach], 0, None).astype(int)
        return slice(first[0], last[0]), slice(first[1], last[1])


def picture(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    size: tuple[int, int],
    goal: Goal | None = None,
    camera: str = "track",
) -> np.ndarray:
    """The state as ``camera`` sees it: u8[height, width, 3].

    Args:
        model: visible boxes, spheres and capsules are drawn; the floor is z = 0.
        data: after `mj_forward`.
        size: width and height, pixels.
        goal: a disc on the floor with a pin.
        camera: name.
    """
    view = Camera(model, data, camera, (SAMPLES * size[0], SAMPLES * size[1]))
    geoms = _geoms(model, data, goal)
    depth, image = _floor(view, data.subtree_com[0], geoms, goal)
    for geom in geoms:
        rows, columns = view.window(geom[2], _radius(geom))
        distance, normal = _hit(geom, view.origin[:, None, None], view.rays[:, rows, columns])
        seen = distance < depth[rows, columns]
        light = AMBIENT + DIFFUSE * np.maximum(SUN @ normal[:, seen], 0.0)
        depth[rows, columns][seen] = distance[seen]
        image[:, rows, columns][:, seen] = geom[4][:, None] * light
    image = image.reshape(3, size[1], SAMPLES, size[0], SAMPLES).mean(axis=(2, 4))
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8).transpose(1, 2, 0)


def _geoms(model: mujoco.MjModel, data: mujoco.MjData, goal: Goal | None) -> list[Geom]:
    geoms = []
    for i in range(model.ngeom):
        rgba = model.geom_rgba[i] if model.geom_matid[i] < 0 else model.mat_rgba[model.geom_matid[i]]
        if rgba[3] > 0 and (kind := int(model.geom_type[i])) in USED:
            size = model.geom_size[i] * USED[kind]
            geoms.append((kind, size, data.geom_xpos[i], data.geom_xmat[i].reshape(3, 3), rgba[:3]))
    if goal is not None:
        for size, height in (((0.006, 0.09, 0.0), 0.09), ((0.02, 0.0, 0.0), 0.2)):
            place, colour = np.array([*goal[0], height]), np.array(goal[2])
            geoms.append((CAPSULE, np.array(size), place, np.eye(3), colour))
    return geoms


def _floor(view: Camera, centre: np.ndarray, geoms: list[Geom], goal: Goal | None) -> tuple[np.ndarray, np.ndarray]:
    """Depth [H, W] and colour [3, H, W] of the floor; above the horizon haze, infinitely far."""
    down = np.minimum(view.rays[2], -1e-9)
    depth = np.where(down < -1e-6, -np.float32(view.origin[2]) / down, np.float32(np.inf))
    near = np.minimum(depth, 100.0)
    place = np.stack([np.float32(view.origin[i]) + near * view.rays[i] for i in range(2)] + [np.zeros_like(near)])
    tile = np.floor(place[:2] / np.float32(TILE)).astype(np.int32)
    bright = np.where((tile[0] + tile[1]) & 1, np.float32(DARK), np.float32(LIGHT))
    shaded = np.zeros(near.shape, bool)
    for geom in geoms:
        # The shadow of a ball is an ellipse, longer than the ball is wide by the slant of the light.
        rows, columns = view.window(geom[2] - SUN * geom[2][2] / SUN[2], _radius(geom) / SUN[2])
        points = place[:, rows, columns]
        distance, _ = _hit(geom, points, np.broadcast_to(SUN.astype(np.float32)[:, None, None], points.shape))
        shaded[rows, columns] |= np.isfinite(distance)
    bright = np.where(shaded, SHADE * bright, bright)
    far = np.clip((np.hypot(place[0] - centre[0], place[1] - centre[1]) - 0.8) / 3.0, 0.0, 1.0).astype(np.float32)
    image = (1 - far) * bright * GREY[:, None, None] + far * HAZE[:, None, None]
    if goal is not None:
        inside = np.hypot(place[0] - goal[0][0], place[1] - goal[0][1]) < goal[1]
        image[:, inside] = 0.55 * image[:, inside] + 0.45 * np.array(goal[2], np.float32)[:, None]
    return depth, image


def _radius(geom: Geom) -> float:
    """Of the sphere about the geom's centre that holds it."""
    kind, size = geom[:2]
    return float(np.linalg.norm(size) if kind == BOX else size[0] + size[1])


def _turn(frame: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """``frame`` times each column of [3, ...]."""
    return (frame.astype(np.float32) @ vectors.reshape(3, -1)).reshape(vectors.shape)


def _hit(geom: Geom, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameter [H, W] at which rays [3, H, W] meet the geom (infinite: never) and its normal there."""
    kind, size, centre, frame, _ = geom
    start = _turn(frame.T, (origin - centre[:, None, None]).astype(np.float32))
    hit = _hit_box if kind == BOX else _hit_capsule
    distance, normal = hit(size.astype(np.float32), start, _turn(frame.T, rays))
    return distance, _turn(frame, normal)


def _hit_box(size: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size, slope = size[:, None, None], np.where(np.abs(along) < 1e-9, np.float32(1e-9), along)
    one, other = (-size - start) / slope, (size - start) / slope
    enter, leave = np.minimum(one, other), np.maximum(one, other).min(0)
    near = enter.max(0)
    normal = -np.sign(along) * (enter == near)
    return np.where((near < leave) & (near > 0), near, np.float32(np.inf)), normal


def _hit_capsule(size: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cylinder of radius size[0] and half length size[1] along z, with round ends; it may be a sphere."""
    radius, half = size[0], size[1]
    side = _hit_round(start[:2], along[:2], radius)
    height = start[2] + np.where(np.isfinite(side), side, 0.0) * along[2]
    ends = np.stack(np.broadcast_arrays(start[0], start[1], start[2] - np.where(height < 0, -half, half)))
    near = np.where(np.abs(height) < half, side, _hit_round(ends, along, radius))
    near = np.where(np.isfinite(side), near, np.float32(np.inf))
    point = start + np.where(np.isfinite(near), near, 0.0) * along
    point[2] -= np.clip(point[2], -half, half)
    return near, (point / radius).astype(np.float32)


def _hit_round(start: np.ndarray, along: np.ndarray, radius: float) -> np.ndarray:
    """Where rays [D, H, W] enter the circle or ball of that radius about 0: [H, W], infinite: never."""
    a = np.maximum((along * along).sum(0), np.float32(1e-12))
    b, c = (start * along).sum(0), (start * start).sum(0) - radius**2
    inside = b * b - a * c
    near = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
    return np.where((inside > 0) & (near > 0), near, np.float32(np.inf))
