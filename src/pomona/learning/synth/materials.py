"""Cycles materials as node trees. The trees come from `blender.py`: nothing here imports `bpy`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pomona.learning.synth.options import Colour, Light, Variety

Builder = Callable[[Any], None]


def _node(tree: Any, kind: str, settings: dict[str, Any] | None = None, **inputs: Any) -> Any:
    """Add a node; `inputs` are values or other nodes' output sockets, by the input's name (spaces as underscores)."""
    node = tree.nodes.new("ShaderNode" + kind)
    for name, value in (settings or {}).items():
        setattr(node, name, value)
    for name, value in inputs.items():
        socket = node.inputs[name.replace("_", " ")]
        if hasattr(value, "is_linked"):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def _finish(tree: Any, shader: Any) -> None:
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])


def _multiply(tree: Any, a: Any, b: Any) -> Any:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY"
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs[0]


def _painted(tree: Any) -> Any:
    """Return the colour socket of the mesh's own colours."""
    return _node(tree, "Attribute", {"attribute_name": "Col"}).outputs["Color"]


def _noise(tree: Any, scale: float, *, detail: float = 4.0, roughness: float = 0.6) -> Any:
    """Return a noise socket (0..1) in the object's own coordinates, `scale` waves a metre."""
    place = _node(tree, "TexCoord").outputs["Object"]
    noise = _node(tree, "TexNoise", Vector=place, Scale=scale, Detail=detail, Roughness=roughness)
    return noise.outputs["Fac"]


def _ramp(tree: Any, value: Any, stops: list[tuple[float, Colour]]) -> Any:
    """Return a colour socket: `value` through a ramp of colours."""
    node = _node(tree, "ValToRGB", Fac=value)
    elements = node.color_ramp.elements
    while len(elements) < len(stops):
        elements.new(0.5)
    for element, (position, colour) in zip(elements, stops, strict=True):
        element.position, element.color = position, (*colour, 1.0)
    return node.outputs["Color"]


def _bump(tree: Any, height: Any, strength: float, distance: float) -> Any:
    return _node(tree, "Bump", Height=height, Strength=strength, Distance=distance).outputs["Normal"]


def leaf(tree: Any) -> None:
    """A leaf: painted green with blotches, half glossy, light shines through it."""
    blotch = _ramp(tree, _noise(tree, 45), [(0.25, (0.7, 0.72, 0.7)), (0.75, (1.3, 1.25, 1.2))])
    colour = _multiply(tree, _painted(tree), blotch)
    shell = _node(tree, "BsdfPrincipled", Base_Color=colour, Roughness=0.42)
    warm = _node(tree, "RGB")
    warm.outputs[0].default_value = (1.9, 2.0, 0.8, 1.0)
    through = _node(tree, "BsdfTranslucent", Color=_multiply(tree, colour, warm.outputs[0]))
    mix = _node(tree, "MixShader", Fac=0.35)
    tree.links.new(shell.outputs[0], mix.inputs[1])
    tree.links.new(through.outputs[0], mix.inputs[2])
    _finish(tree, mix)


def fruit(tree: Any, variety: Variety) -> None:
    """A fruit's skin: painted, with pale dots (lenticels) and mottling, waxy."""
    place = _node(tree, "TexCoord").outputs["Object"]
    cells = _node(tree, "TexVoronoi", Vector=place, Scale=230.0)
    dots = _ramp(tree, cells.outputs["Distance"], [(0.10, (1.5, 1.6, 1.7)), (0.22, (1.0, 1.0, 1.0))])
    mottle = _ramp(tree, _noise(tree, 90), [(0.3, (0.78, 0.78, 0.78)), (0.7, (1.18, 1.18, 1.18))])
    colour = _multiply(tree, _multiply(tree, _painted(tree), dots), mottle)
    normal = _bump(tree, _noise(tree, 320 if variety.bump > 0.05 else 120), variety.bump * 5, 0.0015)
    skin = _node(tree, "BsdfPrincipled", Base_Color=colour, Roughness=variety.roughness, Normal=normal)
    _finish(tree, skin)


def bark(tree: Any) -> None:
    """Bark: painted, with dark fissures and grey lichen."""
    rough = _noise(tree, 60, detail=8)
    tone = _ramp(tree, rough, [(0.3, (0.45, 0.45, 0.45)), (0.55, (1.0, 1.0, 1.0)), (0.8, (2.0, 2.1, 2.0))])
    colour = _multiply(tree, _painted(tree), tone)
    normal = _bump(tree, rough, 0.8, 0.006)
    _finish(tree, _node(tree, "BsdfPrincipled", Base_Color=colour, Roughness=0.85, Normal=normal))


def grass(tree: Any) -> None:
    """Blades of grass: painted, matt."""
    _finish(tree, _node(tree, "BsdfPrincipled", Base_Color=_painted(tree), Roughness=0.6))


def plain(tree: Any) -> None:
    """Posts, wires, stems and marker plates: painted, matt."""
    _finish(tree, _node(tree, "BsdfPrincipled", Base_Color=_painted(tree), Roughness=0.75))


def ground(tree: Any) -> None:
    """Soil with mown grass and straw."""
    patches, grains = _noise(tree, 1.1, detail=6), _noise(tree, 35, detail=9, roughness=0.75)
    soil, sward, green = (0.10, 0.075, 0.05), (0.075, 0.085, 0.03), (0.055, 0.10, 0.022)
    turf = _ramp(tree, patches, [(0.35, soil), (0.5, sward), (0.68, green)])
    speckle = _ramp(tree, grains, [(0.3, (0.35, 0.35, 0.35)), (0.52, (1.0, 1.0, 1.0)), (0.75, (2.3, 2.1, 1.7))])
    normal = _bump(tree, grains, 0.9, 0.03)
    colour = _multiply(tree, turf, speckle)
    _finish(tree, _node(tree, "BsdfPrincipled", Base_Color=colour, Roughness=0.95, Normal=normal))


def hedge(tree: Any) -> None:
    """Trees on the horizon: dark green noise."""
    clumps = _noise(tree, 1.6, detail=8, roughness=0.7)
    tone = _ramp(tree, clumps, [(0.3, (0.010, 0.02, 0.008)), (0.7, (0.07, 0.10, 0.035))])
    _finish(tree, _node(tree, "BsdfDiffuse", Color=tone))


def fruit_id(tree: Any) -> None:
    """The mask pass: light of the colour that encodes the object's index (see `encoding.py`); others stay black."""
    index = _node(tree, "ObjectInfo").outputs["Object Index"]

    def maths(operation: str, a: Any, b: float) -> Any:
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        tree.links.new(a, node.inputs[0])
        node.inputs[1].default_value = b
        return node.outputs[0]

    low = maths("DIVIDE", maths("MODULO", index, 256.0), 255.0)
    high = maths("DIVIDE", maths("FLOOR", maths("DIVIDE", index, 256.0), 0.0), 255.0)
    colour = _node(tree, "CombineColor", Red=low, Green=high, Blue=0.0).outputs[0]
    _finish(tree, _node(tree, "Emission", Color=colour, Strength=1.0))


def sky(tree: Any, light: Light, azimuth_deg: float) -> None:
    """A Nishita sky with its sun, mixed with bright clouds."""
    tree.nodes.clear()
    clear = _node(
        tree,
        "TexSky",
        {
            "sky_type": "NISHITA",
            "sun_elevation": math.radians(light.sun_elevation_deg),
            "sun_rotation": math.radians(azimuth_deg),
            "dust_density": light.haze,
            "sun_intensity": max(0.0, 1 - light.clouds) ** 1.5,
            "sun_size": math.radians(0.8 + 5 * light.clouds),
            "sun_disc": light.clouds < 1,
        },
    ).outputs["Color"]
    place = _node(tree, "TexCoord").outputs["Generated"]
    puffs = _node(tree, "TexNoise", Vector=place, Scale=3.0, Detail=6.0).outputs["Fac"]
    level = 5.0 + 7.0 * light.clouds
    white = _ramp(tree, puffs, [(0.3, (0.62, 0.66, 0.72)), (0.7, (1.0, 1.0, 1.0))])
    bright = _node(tree, "VectorMath", {"operation": "SCALE"}, Scale=level)
    tree.links.new(white, bright.inputs[0])
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.inputs["Factor"].default_value = light.clouds
    tree.links.new(clear, mix.inputs[6])
    tree.links.new(bright.outputs[0], mix.inputs[7])
    background = _node(tree, "Background", Color=mix.outputs[2], Strength=0.1)
    background.name = "Background"
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(background.outputs[0], output.inputs["Surface"])


BUILDERS: dict[str, Builder] = {
    "leaf": leaf, "bark": bark, "grass": grass, "plain": plain, "ground": ground, "hedge": hedge, "fruit_id": fruit_id,
}  # fmt: skip
