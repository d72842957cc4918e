"""A scene of a funnel in Meshcat: a tube round the flight."""

import argparse

import numpy as np
from pydrake.geometry import Meshcat, Rgba

from diagrams.playback import GREY, Track, play
from diagrams.program import finish, start_meshcat
from diagrams.scene import NUM_POSITIONS
from diagrams.studies.funnel_study import FunnelStudy
from glider.verification.funnel.funnel import Funnel, tube_radii

RINGS, SIDES = 90, 24
"""Numbers of vertices of the mesh, along the flight and round it."""


def draw_tube(
    meshcat: Meshcat,
    funnel: Funnel,
    name: str = "funnel",
    color: tuple[float, float, float, float] = (0.2, 0.45, 0.85, 0.25),
) -> None:
    """Draws the positions that a funnel allows as a tube of revolution.

    Args:
        meshcat: where to draw.
        funnel: the funnel.
        name: its path in Meshcat.
        color: red, green, blue, opacity, each from 0 to 1.
    """
    nominal = funnel.nominal
    times = np.linspace(nominal.times[0], nominal.times[-1], RINGS)
    normals, radii = tube_radii(funnel, times)
    centers = funnel.center(times)[:, :2]
    angles = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    vertices = np.zeros((RINGS, SIDES, 3))
    across = radii[:, None] * np.cos(angles)
    vertices[..., 0] = centers[:, :1] + across * normals[:, :1]
    vertices[..., 1] = radii[:, None] * np.sin(angles)
    vertices[..., 2] = centers[:, 1:] + across * normals[:, 1:]
    ring, side = np.meshgrid(np.arange(RINGS - 1), np.arange(SIDES), indexing="ij")
    here, beside = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
    first = np.stack([here, beside, here + SIDES], axis=-1)
    second = np.stack([beside, beside + SIDES, here + SIDES], axis=-1)
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    meshcat.SetTriangleMesh(
        f"/{name}", vertices.reshape(-1, 3).T, faces.T, Rgba(*color), False
    )


def show_funnel(
    args: argparse.Namespace, study: FunnelStudy, title: str, count: int = 3
) -> None:
    """Plays a few flights inside a funnel and its nominal one, as the options say.

    Args:
        args: with the options of `diagrams.program.add_options`.
        study: funnel and flights.
        title: of the page.
        count: how many flights.
    """
    nominal = study.funnel.nominal
    tracks = [
        Track(
            name="nominal", times=nominal.times, poses=nominal.states[:, :NUM_POSITIONS]
        )
    ]
    tracks += [
        Track(name=f"flight {k + 1}", times=nominal.times, poses=path, color=GREY)
        for k, path in enumerate(study.flights[:count, :, :NUM_POSITIONS])
    ]
    meshcat = start_meshcat(args)
    if meshcat is not None:
        draw_tube(meshcat, study.funnel)
        play(tracks, meshcat, rate=args.rate)
    finish(args, meshcat, tracks, title)
