"""A picture of a MuJoCo state without OpenGL: boxes, spheres and capsules on a chequered floor, by casting rays.

Each geom is tested only against the pixels about it, so a frame takes a tenth of a second or so.
"""

import mujoco
import numpy as np

SAMPLES = 2  # rays per pixel in each direction
SUN = np.array([-0.3, -0.4, 1.0]) / np.linalg.norm([0.3, 0.4, 1.0])  # towards the light
TILE = 0.25  # m
LIGHT, DARK = np.array([0.80, 0.81, 0.82]), np.array([0.72, 0.735, 0.75])
HAZE = np.array([0.88, 0.90, 0.93])
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
        plane = np.stack([*np.meshgrid(x, y), np.full((self.height, self.width), -1.0)], axis=-1)
        self.rays = plane @ self.frame.T  # f[H, W, 3], of unit depth: a ray's parameter is a depth

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
    model: mujoco.MjModel, data: mujoco.MjData, size: tuple[int, int], goal: Goal | None = None, camera: str = "track"
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
        rays = view.rays[rows, columns]
        distance, normal = _hit(geom, view.origin, rays)
        seen = distance < depth[rows, columns]
        light = AMBIENT + DIFFUSE * np.maximum(normal[seen] @ SUN, 0.0)
        depth[rows, columns][seen] = distance[seen]
        image[rows, columns][seen] = light[:, None] * geom[4]
    image = image.reshape(size[1], SAMPLES, size[0], SAMPLES, 3).mean(axis=(1, 3))
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)


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
    """Depth f[H, W] and colour f[H, W, 3] of the floor and, above the horizon, of nothing."""
    down = view.rays[..., 2]
    depth = np.where(down < 0, view.origin[2] / np.minimum(down, -1e-9) * -1.0, np.inf)
    near = np.minimum(depth, 1e3)
    place = view.origin[:2] + near[..., None] * view.rays[..., :2]
    odd = np.floor(place / TILE).astype(int).sum(-1) % 2 == 1
    colour = np.where(odd[..., None], DARK, LIGHT)
    if goal is not None:
        inside = np.linalg.norm(place - goal[0], axis=-1) < goal[1]
        colour[inside] = 0.55 * colour[inside] + 0.45 * np.array(goal[2])
    shade = np.ones(depth.shape)
    for geom in geoms:
        # The shadow of a ball is an ellipse, longer than the ball is wide by the slant of the light.
        at, radius = geom[2] - SUN * geom[2][2] / SUN[2], _radius(geom) / SUN[2]
        rows, columns = view.window(at, radius)
        points = np.concatenate([place[rows, columns], np.zeros((*place[rows, columns].shape[:2], 1))], axis=-1)
        distance, _ = _hit(geom, points, np.broadcast_to(SUN, points.shape))
        shade[rows, columns][np.isfinite(distance)] = SHADE
    far = np.clip((np.linalg.norm(place - centre[:2], axis=-1) - 0.8) / 3.0, 0.0, 1.0)[..., None]
    return depth, (1 - far) * colour * shade[..., None] + far * HAZE


def _radius(geom: Geom) -> float:
    """Of the sphere about the geom's centre that holds it."""
    kind, size = geom[:2]
    return float(np.linalg.norm(size) if kind == BOX else size[0] + size[1])


def _hit(geom: Geom, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameter f[...] at which rays meet the geom (infinite where they miss) and its normal there, f[..., 3]."""
    kind, size, centre, frame, _ = geom
    start, along = (origin - centre) @ frame, rays @ frame
    hit = _hit_box if kind == BOX else _hit_capsule
    distance, normal = hit(size, np.broadcast_to(start, along.shape), along)
    return distance, normal @ frame.T


def _hit_box(size: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    slope = np.where(np.abs(along) < 1e-9, 1e-9, along)
    one, other = (-size - start) / slope, (size - start) / slope
    enter, leave = np.minimum(one, other), np.maximum(one, other).min(-1)
    axis = enter.argmax(-1)
    near = enter.max(-1)
    normal = -np.sign(along) * (np.arange(3) == axis[..., None])
    return np.where((near < leave) & (near > 0), near, np.inf), normal


def _hit_capsule(size: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cylinder of radius size[0] and half length size[1] along z with round ends; a sphere where that is 0."""
    radius, half = size[0], size[1]
    near = _hit_round(start[..., :2], along[..., :2], radius)
    height = np.where(np.isfinite(near), start[..., 2] + np.where(np.isfinite(near), near, 0.0) * along[..., 2], 0.0)
    end = np.clip(height, -half, half)
    cap = np.stack([np.zeros_like(end), np.zeros_like(end), np.where(height < 0, -half, half)], axis=-1)
    near = np.where(np.abs(height) < half, near, _hit_round(start - cap, along, radius))
    finite = np.where(np.isfinite(near), near, 0.0)[..., None]
    point = start + finite * along
    point[..., 2] -= np.clip(point[..., 2], -half, half)
    return near, point / radius


def _hit_round(start: np.ndarray, along: np.ndarray, radius: float) -> np.ndarray:
    """Where rays f[..., D] enter the circle or ball of that radius about 0: f[...], infinite where they miss."""
    a = np.maximum(np.sum(along * along, -1), 1e-12)
    b, c = np.sum(start * along, -1), np.sum(start * start, -1) - radius**2
    inside = b * b - a * c
    near = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
    return np.where((inside > 0) & (near > 0), near, np.inf)
