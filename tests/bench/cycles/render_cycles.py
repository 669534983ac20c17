"""Renders the variants of scenes.py with Cycles into the canonical dataset layout, twice with different seeds.

    blender -b -P render_cycles.py -- OUT [VARIANT...]      writes OUT/cycles/VARIANT and OUT/cycles_again/VARIANT

An image that exists is kept.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import bpy
import cycles_scene as cs
import scenes


def schlickNodes(tree, f0):
    """F0 + (1 - F0)(1 - V.H)^5 for the one light at (x, y, z, w) = nodes "light": w = 1 position, w = 0 direction. Linked colour socket."""
    nodes, links = tree.nodes, tree.links
    def vector(op, a, b=None, scale=None):
        node = nodes.new("ShaderNodeVectorMath")
        node.operation = op
        links.new(a, node.inputs[0])
        if b is not None:
            links.new(b, node.inputs[1])
        if scale is not None:
            links.new(scale, node.inputs["Scale"])
        return node
    def scalar(op, a, b):
        node = nodes.new("ShaderNodeMath")
        node.operation = op
        for socket, value in zip(node.inputs, (a, b)):
            if isinstance(value, (int, float)):
                socket.default_value = value
            else:
                links.new(value, socket)
        return node.outputs[0]
    geometry = nodes.new("ShaderNodeNewGeometry")
    position = nodes.new("ShaderNodeCombineXYZ")
    position.name = "light"
    w = nodes.new("ShaderNodeValue")
    w.name = "light w"
    toLight = vector("NORMALIZE", vector("SUBTRACT", position.outputs[0],
                                         vector("SCALE", geometry.outputs["Position"], scale=w.outputs[0]).outputs[0]).outputs[0])
    half = vector("NORMALIZE", vector("ADD", toLight.outputs[0], geometry.outputs["Incoming"]).outputs[0])
    vh = vector("DOT_PRODUCT", half.outputs[0], geometry.outputs["Incoming"]).outputs["Value"]
    power = scalar("POWER", scalar("MAXIMUM", scalar("SUBTRACT", 1.0, vh), 0.0), 5.0)
    combine = nodes.new("ShaderNodeCombineColor")
    for socket, value in zip(combine.inputs, f0):
        links.new(scalar("ADD", scalar("MULTIPLY", power, 1 - value), value), socket)
    return combine.outputs[0]


def glossy(tree, colour, roughness):
    node = tree.nodes.new("ShaderNodeBsdfGlossy")
    node.distribution = "GGX"
    node.inputs["Roughness"].default_value = roughness
    if isinstance(colour, list):
        node.inputs["Color"].default_value = (*colour, 1)
    else:
        tree.links.new(colour, node.inputs["Color"])
    return node.outputs[0]


def volumeMaterial(variant):
    """sigma_t = 1 / mfp, sigma_s = alpha sigma_t: a scattering node and an absorbing one, whose colours are shares of their densities."""
    material, tree, output = cs.newMaterial("volume")
    sigmaT, alpha = 1 / np.array(variant["mfp"]), np.array(variant["alpha"])
    scatter, absorb, add = (tree.nodes.new("ShaderNode" + name) for name in ("VolumeScatter", "VolumeAbsorption", "AddShader"))
    for node, sigma in ((scatter, sigmaT * alpha), (absorb, sigmaT * (1 - alpha))):
        share = sigma / sigma.max()
        node.inputs["Density"].default_value = sigma.max()
        node.inputs["Color"].default_value = (*(share if node is scatter else 1 - share), 1)
        tree.links.new(node.outputs[0], add.inputs[0 if node is scatter else 1])
    scatter.inputs["Anisotropy"].default_value = variant["g"]
    tree.links.new(add.outputs[0], output.inputs["Volume"])
    material.cycles.homogeneous_volume = True
    if variant["boundary"] == "dielectric":
        glass = tree.nodes.new("ShaderNodeBsdfGlass")
        glass.distribution = "GGX"
        glass.inputs["Color"].default_value = (1, 1, 1, 1)
        glass.inputs["Roughness"].default_value = variant["roughness"]
        glass.inputs["IOR"].default_value = 1.5
        tree.links.new(glass.outputs[0], output.inputs["Surface"])
    return material


def makeMaterial(variant):
    kind = variant["kind"]
    if kind == "volume":
        return volumeMaterial(variant)
    if kind == "diffuse":
        return cs.diffuseMaterial(variant["color"])
    if kind == "wax":
        return cs.subsurfaceMaterial(variant["color"], [4 * np.pi * m for m in variant["mfp"]], "RANDOM_WALK_FIXED_RADIUS")
    material, tree, output = cs.newMaterial(kind)
    if kind == "glossy":
        surface = glossy(tree, variant["color"], variant["roughness"])
    elif kind == "conductor":
        surface = glossy(tree, schlickNodes(tree, variant["color"]), variant["roughness"])
    else:  # dielectric of index 1.5: mix(diffuse, specular, F)
        fresnel = schlickNodes(tree, [0.04] * 3)
        white = tree.nodes.new("ShaderNodeMix")  # base colour * (1 - F)
        white.data_type = "RGBA"
        colours = [s for s in white.inputs if s.type == "RGBA"]
        factor = next(s for s in white.inputs if s.type == "VALUE")
        tree.links.new(fresnel, factor)
        colours[0].default_value, colours[1].default_value = (*variant["color"], 1), (0, 0, 0, 1)
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        tree.links.new(next(s for s in white.outputs if s.type == "RGBA"), diffuse.inputs["Color"])
        add = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(diffuse.outputs[0], add.inputs[0])
        tree.links.new(glossy(tree, fresnel, variant["roughness"]), add.inputs[1])
        surface = add.outputs[0]
    tree.links.new(surface, output.inputs["Surface"])
    return material


def setLight(light, material, out):
    for obj in [o for o in bpy.context.scene.objects if o.type == "LIGHT"]:
        bpy.data.objects.remove(obj)
    cs.setEnvironment(None)
    nodes = material.node_tree.nodes
    if light["type"] == "point":
        cs.addPoint(light["position"], light["intensity"])
    elif light["type"] == "directional":
        cs.addDirectional(light["direction_to_light"], light["irradiance"])
    else:
        cs.setEnvironment(os.path.join(out, "env.exr"))
    if "light" in nodes:
        vector = light["position"] if light["type"] == "point" else light["direction_to_light"]
        for socket, value in zip(nodes["light"].inputs, vector):
            socket.default_value = value
        nodes["light w"].outputs[0].default_value = 1.0 if light["type"] == "point" else 0.0


def main():
    arguments = sys.argv[sys.argv.index("--") + 1:]
    out, names = os.path.abspath(arguments[0]), arguments[1:] or list(scenes.VARIANTS)
    for name in names:
        variant = scenes.VARIANTS[name]
        for seed, folder in enumerate(("cycles", "cycles_again")):
            folder = os.path.join(out, folder, name)
            os.makedirs(folder, exist_ok=True)
            cs.reset(scenes.SAMPLES.get(name, scenes.SAMPLES.get(variant["kind"])), seed, (scenes.SIZE, scenes.SIZE))
            material = makeMaterial(variant)
            v, n, f = scenes.MESHES[variant["mesh"]]()
            cs.addMesh("object", v, f, n, material)
            for split, frames in scenes.splits(variant).items():
                for i, (camera, light) in enumerate(frames):
                    path = os.path.join(folder, split, "%03d.exr" % i)
                    if os.path.exists(path):
                        continue
                    old = bpy.context.scene.camera
                    cs.addCamera(scenes.CAMERAS[camera], angleX=scenes.CAMERA_ANGLE_X)
                    if old:
                        bpy.data.objects.remove(old)
                    setLight(light, material, out)
                    # Through a volume without surface a transparent film leaves out what lies straight behind; ours shows it.
                    bpy.context.scene.render.film_transparent = not (variant.get("boundary") == "none" and split == "environment")
                    cs.renderTo(path)
            scenes.writeTransforms(folder, name, variant, "Blender %s Cycles" % bpy.app.version_string)
    for folder in ("cycles", "cycles_again"):  # "../env.exr" of the description files
        with open(os.path.join(out, "env.exr"), "rb") as source, open(os.path.join(out, folder, "env.exr"), "wb") as copy:
            copy.write(source.read())


main()
