"""A made scene, and writers of it in the files of other programs, each by that program's own published formulas.

These writers share nothing with the readers under test: they project with the formula that the program's manual gives,
in its own pixels and axes, and say by how much its pixels differ from COLMAP's, which Pomona uses.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.values.cameras import WorldFrame
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT = 1600, 1200


@dataclass(frozen=True)
class Scene:
    """Cameras that look at points around the origin. `rotations` (n, 3, 3) lead from the world to the cameras."""

    names: list[str]
    rotations: np.ndarray
    centers: np.ndarray
    points: np.ndarray
    rgb: np.ndarray

    def in_cam(self, i: int) -> np.ndarray:
        return (self.points - self.centers[i]) @ self.rotations[i].T


def make_scene(seed: int, cameras: int = 4, points: int = 40) -> Scene:
    rng = np.random.default_rng(seed)
    centers, rotations = [], []
    for _ in range(cameras):
        center = np.array([rng.uniform(-3, 3), -5 + rng.uniform(-1, 1), rng.uniform(-1, 2)])
        forward = rng.uniform(-0.3, 0.3, 3) - center
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, np.array([0, 0, 1.0]) + rng.normal(0, 0.2, 3))
        right /= np.linalg.norm(right)
        centers.append(center)
        rotations.append(np.array([right, np.cross(forward, right), forward]))
    names = [f"row/IMG_{i:04}.JPG" for i in range(cameras)]
    xyz = rng.uniform(-1.2, 1.2, (points, 3))
    return Scene(names, np.array(rotations), np.array(centers), xyz, rng.integers(0, 256, (points, 3)))


def photos_of(scene: Scene, width: int = WIDTH, height: int = HEIGHT) -> Photos:
    return Photos(tuple(Photo(name, Path("/photos") / name, width, height) for name in scene.names))


@dataclass(frozen=True)
class Written:
    """A file, and by photo what its program says of where the scene's points are, in COLMAP's pixels.

    `moved` leads from the scene's world into that of the values read, given their frame.
    """

    path: Path
    px: list[np.ndarray]
    moved: Callable[[np.ndarray, WorldFrame], np.ndarray] = lambda points, frame: points


Writer = Callable[[Scene, Path, np.random.Generator], Written]


def _ideal(scene: Scene, i: int) -> tuple[np.ndarray, np.ndarray]:
    cam = scene.in_cam(i)
    return cam[:, 0] / cam[:, 2], cam[:, 1] / cam[:, 2]


def _opencv(x: np.ndarray, y: np.ndarray, k: list[float], p1: float, p2: float) -> tuple[np.ndarray, np.ndarray]:
    """Brown's distortion as OpenCV's documentation has it, with as many radial coefficients as there are."""
    r2 = x**2 + y**2
    radial = 1 + sum(c * r2 ** (n + 1) for n, c in enumerate(k))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )


def write_bundler(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
    """Bundler's manual: P = R X + t; p = -P / P.z; p' = f r(p) p; from the photo's centre, y up."""
    f, k1, k2 = rng.uniform(1000, 1800), rng.uniform(-0.2, 0.1), rng.uniform(-0.05, 0.05)
    flip = np.diag([1.0, -1, -1])
    lines = ["# Bundle file v0.3", f"{len(scene.names)} {len(scene.points)}"]
    px, views = [], [[] for _ in scene.points]
    for i in range(len(scene.names)):
        rotation = flip @ scene.rotations[i]
        translation = -rotation @ scene.centers[i]
        lines.append(f"{f!r} {k1!r} {k2!r}")
        lines += [" ".join(repr(float(v)) for v in row) for row in [*rotation, translation]]
        inside = scene.points @ rotation.T + translation
        p = -inside[:, :2] / inside[:, 2:]
        n = (p**2).sum(1)
        seen = f * (1 + k1 * n + k2 * n**2)[:, None] * p
        px.append(np.stack([WIDTH / 2 + seen[:, 0], HEIGHT / 2 - seen[:, 1]], 1))
        for j, (x, y) in enumerate(seen):
            views[j].append(f"{i} {j} {x:.4f} {y:.4f}")
    for j, point in enumerate(scene.points):
        lines += [" ".join(map(repr, point.tolist())), " ".join(map(str, scene.rgb[j]))]
        lines.append(f"{len(views[j])} " + " ".join(views[j]))
    path = folder / "bundle.out"
    path.write_text("\n".join(lines) + "\n")
    (folder / "list.txt").write_text("".join(f"./{name} 0 {f:.2f}\n" for name in scene.names))
    return Written(path, px)


def _quaternion(rotation: np.ndarray) -> list[float]:
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    x = np.sqrt(max(0.0, 1 + rotation[0, 0] - rotation[1, 1] - rotation[2, 2])) / 2
    y = np.sqrt(max(0.0, 1 - rotation[0, 0] + rotation[1, 1] - rotation[2, 2])) / 2
    z = np.sqrt(max(0.0, 1 - rotation[0, 0] - rotation[1, 1] + rotation[2, 2])) / 2
    x, y, z = (
        np.copysign(x, rotation[2, 1] - rotation[1, 2]),
        np.copysign(y, rotation[0, 2] - rotation[2, 0]),
        np.copysign(z, rotation[1, 0] - rotation[0, 1]),
    )
    return [float(w), float(x), float(y), float(z)]


_COLMAP_IDS = {"SIMPLE_RADIAL": 2, "OPENCV": 4, "OPENCV_FISHEYE": 5, "RADIAL_FISHEYE": 9}


def _colmap_lens(model: str, rng: np.random.Generator) -> tuple[list[float], Callable]:
    """Parameters, and COLMAP's ImgFromCam of that model."""
    f, cx, cy = rng.uniform(1000, 1800), WIDTH / 2 + rng.uniform(-20, 20), HEIGHT / 2 + rng.uniform(-20, 20)
    k1, k2, p1, p2 = rng.uniform(-0.1, 0.1), rng.uniform(-0.05, 0.05), *rng.uniform(-0.003, 0.003, 2).tolist()
    fy = f * 1.01
    if model == "SIMPLE_RADIAL":
        return [f, cx, cy, k1], lambda x, y: (lambda s: np.stack([f * x * s + cx, f * y * s + cy], 1))(
            1 + k1 * (x**2 + y**2)
        )
    if model == "OPENCV":

        def opencv(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            u, v = _opencv(x, y, [k1, k2], p1, p2)
            return np.stack([f * u + cx, fy * v + cy], 1)

        return [f, fy, cx, cy, k1, k2, p1, p2], opencv
    coefficients = [k1, k2, p1, p2] if model == "OPENCV_FISHEYE" else [k1, k2]
    focals = [f, fy] if model == "OPENCV_FISHEYE" else [f]

    def fisheye(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        r = np.hypot(x, y)
        theta = np.arctan(r)
        bent = theta * (1 + sum(c * theta ** (2 * n + 2) for n, c in enumerate(coefficients))) / r
        return np.stack([focals[0] * x * bent + cx, focals[-1] * y * bent + cy], 1)

    return [*focals, cx, cy, *coefficients], fisheye


def colmap_binary(model: str) -> Writer:
    """https://colmap.github.io/format.html#binary-file-format."""

    def write(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
        params, project = _colmap_lens(model, rng)
        with (folder / "cameras.bin").open("wb") as file:
            file.write(struct.pack("<Q", 1))
            file.write(struct.pack("<IiQQ", 7, _COLMAP_IDS[model], WIDTH, HEIGHT))
            file.write(struct.pack(f"<{len(params)}d", *params))
        px = [project(*_ideal(scene, i)) for i in range(len(scene.names))]
        with (folder / "images.bin").open("wb") as file:
            file.write(struct.pack("<Q", len(scene.names)))
            for i, name in enumerate(scene.names):
                translation = -scene.rotations[i] @ scene.centers[i]
                file.write(struct.pack("<I7dI", i + 3, *_quaternion(scene.rotations[i]), *translation, 7))
                file.write(name.encode() + b"\0" + struct.pack("<Q", len(px[i])))
                for j, (x, y) in enumerate(px[i]):
                    file.write(struct.pack("<ddQ", x, y, j + 1))
        with (folder / "points3D.bin").open("wb") as file:
            file.write(struct.pack("<Q", len(scene.points)))
            for j, point in enumerate(scene.points):
                file.write(struct.pack("<Q3d3Bd", j + 1, *point, *scene.rgb[j].tolist(), 0.5))
                file.write(struct.pack("<Q", len(scene.names)))
                file.write(b"".join(struct.pack("<II", i + 3, j) for i in range(len(scene.names))))
        return Written(folder, px)

    return write


def write_colmap_text(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
    params, project = _colmap_lens("OPENCV", rng)
    px = [project(*_ideal(scene, i)) for i in range(len(scene.names))]
    (folder / "cameras.txt").write_text(f"# cameras\n2 OPENCV {WIDTH} {HEIGHT} {' '.join(map(repr, params))}\n")
    lines = []
    for i, name in enumerate(scene.names):
        numbers = [*_quaternion(scene.rotations[i]), *(-scene.rotations[i] @ scene.centers[i]).tolist()]
        lines.append(f"{i + 3} {' '.join(map(repr, numbers))} 2 {name}")
        lines.append(" ".join(f"{x!r} {y!r} {j + 1}" for j, (x, y) in enumerate(px[i].tolist())))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    track = lambda j: " ".join(f"{i + 3} {j}" for i in range(len(scene.names)))  # noqa: E731
    (folder / "points3D.txt").write_text(
        "".join(
            f"{j + 1} {' '.join(map(repr, p.tolist()))} {' '.join(map(str, scene.rgb[j]))} 0.5 {track(j)}\n"
            for j, p in enumerate(scene.points)
        )
    )
    return Written(folder, px)


def opensfm(kind: str, lla: tuple[float, float, float] | None = None) -> Writer:
    """https://opensfm.org/docs/geometry.html: normalised by the longer side, from the middle of the photo."""

    def write(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
        f, k1, k2, k3 = rng.uniform(0.7, 1.1), *rng.uniform(-0.05, 0.05, 3).tolist()
        p1, p2, cx, cy = *rng.uniform(-0.003, 0.003, 2).tolist(), *rng.uniform(-0.01, 0.01, 2).tolist()
        camera = {"projection_type": kind, "width": WIDTH, "height": HEIGHT, "k1": k1, "k2": k2}
        if kind == "brown":
            camera |= {"focal_x": f, "focal_y": f * 1.01, "c_x": cx, "c_y": cy, "k3": k3, "p1": p1, "p2": p2}
        else:
            camera |= {"focal": f}
        shots, px, tracks = {}, [], ["OPENSFM_TRACKS_VERSION_v2"]
        for i, name in enumerate(scene.names):
            x, y = _ideal(scene, i)
            if kind == "brown":
                u, v = _opencv(x, y, [k1, k2, k3], p1, p2)
                u, v = f * u + cx, f * 1.01 * v + cy
            elif kind == "perspective":
                d = 1 + k1 * (x**2 + y**2) + k2 * (x**2 + y**2) ** 2
                u, v = f * d * x, f * d * y
            else:
                r = np.hypot(x, y)
                theta = np.arctan(r)
                d = 1 + k1 * theta**2 + k2 * theta**4
                u, v = f * d * theta * x / r, f * d * theta * y / r
            # To pixels whose first has its centre at (0, 0), then to COLMAP's.
            size = max(WIDTH, HEIGHT)
            px.append(np.stack([u * size + (WIDTH - 1) / 2 + 0.5, v * size + (HEIGHT - 1) / 2 + 0.5], 1))
            angle = np.arccos(np.clip((np.trace(scene.rotations[i]) - 1) / 2, -1, 1))
            m = scene.rotations[i]
            axis = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / (2 * np.sin(angle))
            translation = -m @ scene.centers[i]
            shots[name] = {
                "rotation": (angle * axis).tolist(), "translation": translation.tolist(), "camera": "v2 one",
                "orientation": 1, "capture_time": 0.0, "gps_dop": 15.0,
            }  # fmt: skip
            tracks += [f"{name}\t{j}\t{j}\t{a!r}\t{b!r}\t0.01\t1\t2\t3\t-1\t-1" for j, (a, b) in
                       enumerate(zip(u.tolist(), v.tolist(), strict=True))]  # fmt: skip
        points = {str(j): {"coordinates": p.tolist(), "color": c.tolist()}
                  for j, (p, c) in enumerate(zip(scene.points, scene.rgb.astype(float), strict=True))}  # fmt: skip
        part = {"cameras": {"v2 one": camera}, "shots": shots, "points": points}
        latitude, longitude, altitude = lla or (0.0, 0.0, 0.0)
        part["reference_lla"] = {"latitude": latitude, "longitude": longitude, "altitude": altitude}
        path = folder / "reconstruction.json"
        path.write_text(json.dumps([part]))
        (folder / "tracks.csv").write_text("\n".join(tracks) + "\n")
        return Written(path, px)

    return write


def nerfstudio(fisheye: bool, per_frame: bool = False, moved: bool = True) -> Writer:
    """https://docs.nerf.studio/quickstart/data_conventions.html: OpenGL's camera axes, poses camera to world."""

    def write(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
        f, cx, cy = rng.uniform(1000, 1800), WIDTH / 2 + rng.uniform(-20, 20), HEIGHT / 2 + rng.uniform(-20, 20)
        k1, k2, k3, k4 = rng.uniform(-0.05, 0.05, 4).tolist()
        p1, p2 = rng.uniform(-0.003, 0.003, 2).tolist()
        lens = {"w": WIDTH, "h": HEIGHT, "fl_x": f, "fl_y": f * 1.01, "cx": cx, "cy": cy, "k1": k1, "k2": k2,
                "k3": k3, "k4": k4, "camera_model": "OPENCV_FISHEYE" if fisheye else "OPENCV"}  # fmt: skip
        lens |= {} if fisheye else {"p1": p1, "p2": p2}
        # What nerfstudio's colmap_to_json does to the world, and a factor.
        applied = np.array([[1.0, 0, 0, 0.3], [0, 0, 1, -0.1], [0, -1, 0, 0.7]]) if moved else np.eye(4)[:3]
        scale = 0.5 if moved else 1.0
        frames, px = [], []
        for i, name in enumerate(scene.names):
            x, y = _ideal(scene, i)
            if fisheye:
                theta, r = np.arctan(np.hypot(x, y)), np.hypot(x, y)
                d = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8) / r
                u, v = x * d, y * d
            else:
                u, v = _opencv(x, y, [k1, k2, k3, k4], p1, p2)
            px.append(np.stack([f * u + cx, f * 1.01 * v + cy], 1))
            matrix = np.eye(4)
            matrix[:3, :3] = applied[:, :3] @ scene.rotations[i].T @ np.diag([1.0, -1, -1])
            matrix[:3, 3] = scale * (applied[:, :3] @ scene.centers[i] + applied[:, 3])
            frames.append({"file_path": f"images/{name}", "transform_matrix": matrix.tolist()})
            frames[-1] |= lens if per_frame else {}
        content = ({} if per_frame else lens) | {"frames": frames, "ply_file_path": "sparse_pc.ply"}
        if moved:
            content |= {"applied_transform": applied.tolist(), "applied_scale": scale}
        path = folder / "transforms.json"
        path.write_text(json.dumps(content))
        there = scale * (scene.points @ applied[:, :3].T + applied[:, 3])
        kinds = [f"property float {axis}" for axis in "xyz"] + [f"property uint8 {c}" for c in ("red", "green", "blue")]
        head = "\n".join(["ply", "format ascii 1.0", "comment made", "element vertex {}", *kinds, "end_header", ""])
        rows = [f"{a!r} {b!r} {c!r} {r} {g} {bl}" for (a, b, c), (r, g, bl) in
                zip(there.tolist(), scene.rgb.tolist(), strict=True)]  # fmt: skip
        (folder / "sparse_pc.ply").write_text(head.format(len(there)) + "\n".join(rows) + "\n")
        return Written(path, px)

    return write


def openmvg(kind: str) -> Writer:
    """OpenMVG: x = K D(R (X - C)); the first pixel's centre is (0, 0). The archive names kinds once (cereal)."""

    def write(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
        f, cx, cy = rng.uniform(1000, 1800), WIDTH / 2 + rng.uniform(-20, 20), HEIGHT / 2 + rng.uniform(-20, 20)
        k, t1, t2 = rng.uniform(-0.05, 0.05, 4).tolist(), *rng.uniform(-0.003, 0.003, 2).tolist()
        common = {"width": WIDTH, "height": HEIGHT, "focal_length": f, "principal_point": [cx, cy]}
        data = {
            "pinhole": common,
            "pinhole_radial_k1": common | {"disto_k1": k[:1]},
            "pinhole_radial_k3": common | {"disto_k3": k[:3]},
            "pinhole_brown_t2": {"value0": common, "disto_t2": [*k[:3], t1, t2]},
            "fisheye": common | {"fisheye": k},
        }[kind]
        views, extrinsics, px = [], [], []
        observations: list[list] = [[] for _ in scene.points]
        for i, name in enumerate(scene.names):
            x, y = _ideal(scene, i)
            r2 = x**2 + y**2
            if kind == "fisheye":
                theta = np.arctan(np.sqrt(r2))
                d = theta * (1 + sum(c * theta ** (2 * n + 2) for n, c in enumerate(k))) / np.sqrt(r2)
                u, v = x * d, y * d
            else:
                count = {"pinhole": 0, "pinhole_radial_k1": 1}.get(kind, 3)
                bent = 1 + sum(c * r2 ** (n + 1) for n, c in enumerate(k[:count]))
                s1, s2 = (t1, t2) if kind == "pinhole_brown_t2" else (0.0, 0.0)
                u = x * bent + s2 * (r2 + 2 * x**2) + 2 * s1 * x * y
                v = y * bent + s1 * (r2 + 2 * y**2) + 2 * s2 * x * y
            seen = np.stack([f * u + cx, f * v + cy], 1)
            px.append(seen + 0.5)
            view = {"local_path": "row", "filename": Path(name).name, "width": WIDTH, "height": HEIGHT,
                    "id_view": i, "id_intrinsic": i % 2, "id_pose": i}  # fmt: skip
            pointer = {"id": 2**31 + 1 + i, "data": view}
            views.append({"key": i, "value": {"polymorphic_id": 2**30, "ptr_wrapper": pointer}})
            pose = {"rotation": scene.rotations[i].tolist(), "center": scene.centers[i].tolist()}
            extrinsics.append({"key": i, "value": pose})
            for j, xy in enumerate(seen.tolist()):
                observations[j].append({"key": i, "value": {"id_feat": j, "x": xy}})
        first = {"polymorphic_id": 2**31 + 1, "polymorphic_name": kind, "ptr_wrapper": {"id": 2**31 + 90, "data": data}}
        second = {"polymorphic_id": 1, "ptr_wrapper": {"id": 2**31 + 91, "data": data}}
        structure = [{"key": j, "value": {"X": p.tolist(), "observations": observations[j]}}
                     for j, p in enumerate(scene.points)]  # fmt: skip
        content = {"sfm_data_version": "0.3", "root_path": "/elsewhere", "views": views,
                   "intrinsics": [{"key": 0, "value": first}, {"key": 1, "value": second}],
                   "extrinsics": extrinsics, "structure": structure, "control_points": []}  # fmt: skip
        path = folder / "sfm_data.json"
        path.write_text(json.dumps(content))
        return Written(path, px)

    return write


WGS84 = (
    'GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG",'
    '"7030"]],TOWGS84[0,0,0,0,0,0,0],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT['
    '"degree",0.01745329251994328,AUTHORITY["EPSG","9102"]],AUTHORITY["EPSG","4326"]]'
)
LOCAL = (
    'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],'
    'AXIS["X",EAST],AXIS["Y",NORTH],AXIS["Z",UP]]'
)
PLACE = (41.6215, 0.5954, 187.3)


def geocentric(latitude: float, longitude: float, height: float) -> np.ndarray:
    """The closed formula of every textbook, on WGS 84."""
    a, e2 = 6378137.0, 6.69437999014e-3
    b, ll = np.radians(latitude), np.radians(longitude)
    n = a / np.sqrt(1 - e2 * np.sin(b) ** 2)
    horizontal = (n + height) * np.cos(b)
    return np.array([horizontal * np.cos(ll), horizontal * np.sin(ll), (n * (1 - e2) + height) * np.sin(b)])


def enu_axes(latitude: float, longitude: float) -> np.ndarray:
    """Rows: east, north, up."""
    b, ll = np.radians(latitude), np.radians(longitude)
    up = np.array([np.cos(b) * np.cos(ll), np.cos(b) * np.sin(ll), np.sin(b)])
    east = np.array([-np.sin(ll), np.cos(ll), 0])
    return np.array([east, np.cross(up, east), up])


def metashape(kind: str = "frame", *, place: str = "local", skew: float = 0.02, components: bool = False) -> Writer:
    """Agisoft's manual, appendix "Camera models"; `place`: local or earth (WGS 84), referenced; or none."""

    def write(scene: Scene, folder: Path, rng: np.random.Generator) -> Written:
        f, cx, cy = rng.uniform(1000, 1800), rng.uniform(-20, 20), rng.uniform(-20, 20)
        k1, k2, k3, k4 = rng.uniform(-0.05, 0.05, 4).tolist()
        p1, p2, b1, b2 = *rng.uniform(-0.002, 0.002, 2).tolist(), rng.uniform(-5, 5), rng.uniform(-1, 1) * skew
        if kind != "frame":
            p1 = p2 = 0.0
            f = max(f, 1300)  # a wider one may see more than 170 degrees, which is refused
        # The chunk's own frame: turned, moved and of another scale.
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        size, shift = rng.uniform(0.1, 10), rng.normal(size=3)
        cameras, px = [], []
        for i, name in enumerate(scene.names):
            x, y = _ideal(scene, i)
            if kind == "fisheye":
                r0 = np.hypot(x, y)
                x, y = x * np.arctan(r0) / r0, y * np.arctan(r0) / r0
            r2 = x**2 + y**2
            radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
            u = x * radial + p1 * (r2 + 2 * x**2) + 2 * p2 * x * y
            v = y * radial + p2 * (r2 + 2 * y**2) + 2 * p1 * x * y
            px.append(np.stack([WIDTH * 0.5 + cx + u * f + u * b1 + v * b2, HEIGHT * 0.5 + cy + v * f], 1))
            matrix = np.eye(4)
            matrix[:3, :3] = turn @ scene.rotations[i].T
            matrix[:3, 3] = size * turn @ scene.centers[i] + shift
            numbers = " ".join(repr(float(value)) for value in matrix.ravel())
            cameras.append(
                f'<camera id="{i}" sensor_id="0" component_id="0" label="{Path(name).stem}">'
                f"<transform>{numbers}</transform><orientation>1</orientation>"
                f'<reference x="{float(scene.centers[i][0])!r}" y="1" z="2" enabled="true"/></camera>'
            )
        world_from_chunk = turn.T, -turn.T @ shift / size, 1 / size
        if place == "earth":
            axes, origin = enu_axes(*PLACE[:2]), geocentric(*PLACE)
            world_from_chunk = axes.T @ turn.T, axes.T @ world_from_chunk[1] + origin, 1 / size
        transform = "".join(
            f'<{name} locked="true">{" ".join(repr(float(v)) for v in np.ravel(value))}</{name}>'
            for name, value in zip(("rotation", "translation", "scale"), world_from_chunk, strict=True)
        )
        transform = f"<transform>{transform}</transform>" if place != "none" else ""
        inner = f'<components next_id="1" active_id="0"><component id="0" label="Component 1">{transform}<partition>'
        inner += "<camera_ids>0 1 2 3</camera_ids></partition></component></components>"
        calibration = f"<f>{f!r}</f><cx>{cx!r}</cx><cy>{cy!r}</cy><b1>{b1!r}</b1><b2>{b2!r}</b2><k1>{k1!r}</k1>"
        calibration += f"<k2>{k2!r}</k2><k3>{k3!r}</k3><k4>{k4!r}</k4><p1>{p1!r}</p1><p2>{p2!r}</p2>"
        resolution = f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
        text = f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
<sensors next_id="1"><sensor id="0" label="made" type="{kind}">{resolution}
<property name="layer_index" value="0"/>
<calibration type="{kind}" class="initial">{resolution}<f>1000</f></calibration>
<calibration type="{kind}" class="adjusted">{resolution}{calibration}</calibration></sensor></sensors>
{inner if components or place == "none" else ""}
<cameras next_id="9" next_group_id="1"><group id="0" label="row" type="folder">{"".join(cameras[:2])}</group>
{"".join(cameras[2:])}
<camera id="7" sensor_id="0" label="IMG_0100"/>
<camera id="8" sensor_id="0" label="IMG_0101" enabled="0"><transform>{" ".join("1000010000100001")}</transform></camera>
</cameras>
{_markers(scene, px) if place == "local" else ""}
<reference>{(WGS84 if place == "earth" else LOCAL).replace('"', "&quot;")}</reference>
{transform if not components else ""}
</chunk></document>
"""
        path = folder / "cameras.xml"
        path.write_text(text)
        if place == "none":
            return Written(path, px, lambda points, _: size * points @ turn.T + shift)
        return Written(path, px, _on_earth if place == "earth" else lambda points, _: points)

    return write


def _on_earth(points: np.ndarray, frame: WorldFrame) -> np.ndarray:
    assert frame.origin is not None
    on_earth = geocentric(*PLACE) + points @ enu_axes(*PLACE[:2])
    return (on_earth - geocentric(*frame.origin)) @ enu_axes(*frame.origin[:2]).T


def _markers(scene: Scene, px: list[np.ndarray]) -> str:
    """Three of the points as markers, of which the last one's reference is 30 mm off."""
    entries, seen = [], []
    for j in range(3):
        x, y, z = (scene.points[j] + [0, 0, 0.03 * (j == 2)]).tolist()
        entries.append(
            f'<marker id="{j}" label="target {j}"><reference x="{x!r}" y="{y!r}" z="{z!r}" enabled="1"/></marker>'
        )
        places = [
            f'<location camera_id="{i}" pinned="1" x="{float(px[i][j][0])!r}" y="{float(px[i][j][1])!r}"/>'
            for i in range(3)
        ]
        seen.append(f'<marker marker_id="{j}">{"".join(places)}<location camera_id="7" pinned="0" valid="0"/></marker>')
    frames = f'<frames next_id="1"><frame id="0"><markers>{"".join(seen)}</markers></frame></frames>'
    return f'<markers next_id="3" next_group_id="0">{"".join(entries)}</markers>{frames}'


WRITERS: dict[str, Writer] = {
    "bundler": write_bundler,
    "colmap text": write_colmap_text,
    **{f"colmap {model}": colmap_binary(model) for model in _COLMAP_IDS},
    **{f"opensfm {kind}": opensfm(kind) for kind in ("perspective", "brown", "fisheye")},
    "opensfm gps": opensfm("brown", PLACE),
    "nerfstudio": nerfstudio(fisheye=False),
    "nerfstudio per frame": nerfstudio(fisheye=False, per_frame=True, moved=False),
    "nerfstudio fisheye": nerfstudio(fisheye=True),
    **{f"openmvg {kind}": openmvg(kind) for kind in
       ("pinhole", "pinhole_radial_k1", "pinhole_radial_k3", "pinhole_brown_t2", "fisheye")},
    "metashape local": metashape(),
    "metashape earth": metashape(place="earth"),
    "metashape components": metashape(place="earth", components=True),
    "metashape not referenced": metashape(place="none"),
    "metashape fisheye": metashape("fisheye"),
}  # fmt: skip
METRIC = ("opensfm gps", "metashape local", "metashape earth", "metashape components", "metashape fisheye")
WITH_TRACKS = ("bundler", "colmap", "opensfm", "openmvg")
WITH_POINTS = (*WITH_TRACKS, "nerfstudio")
