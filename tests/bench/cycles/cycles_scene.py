"""Blender scenes built from arrays, rendered by Cycles to linear float pixels. Imported inside Blender by the scripts beside it."""
import math
import os
import tempfile

import bpy
import mathutils
import numpy as np


def reset(samples, seed, size):
    """An empty scene with every feature of Cycles off that biases or filters: clamps, glossy blur, denoising, adaptive sampling."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = samples, seed
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = cycles.volume_bounces = 64
    cycles.pixel_filter_type = "BOX"  # one pixel wide
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Raw"
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth, settings.exr_codec = "OPEN_EXR", "RGBA", "32", "ZIP"
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def addMesh(name, v, f, n=None, material=None):
    """`n`: a normal per vertex; None shades flat."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(v.tolist(), [], f.tolist())
    if n is not None:
        mesh.polygons.foreach_set("use_smooth", np.ones(len(f), dtype=bool))
        mesh.use_auto_smooth = True  # what makes Blender 3 use custom normals
        mesh.normals_split_custom_set_from_vertices(n.tolist())
    mesh.update()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    obj.cycles.shadow_terminator_geometry_offset = 0.0  # moves the origin of shadow rays; the published model has no such thing
    obj.cycles.shadow_terminator_offset = 0.0
    if material:
        mesh.materials.append(material)
    return obj


def newMaterial(name):
    """Material, its node tree and its output node; the caller links a surface."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    return material, tree, tree.nodes.new("ShaderNodeOutputMaterial")


def subsurfaceMaterial(colour, radius, method):
    """The Subsurface Scattering node with scale 1."""
    material, tree, output = newMaterial("subsurface")
    node = tree.nodes.new("ShaderNodeSubsurfaceScattering")
    node.falloff = method
    node.inputs["Color"].default_value = (*colour, 1)
    node.inputs["Scale"].default_value = 1.0
    node.inputs["Radius"].default_value = radius
    node.inputs["IOR"].default_value = 1.4
    node.inputs["Anisotropy"].default_value = 0.0
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def diffuseMaterial(colour):
    material, tree, output = newMaterial("diffuse")
    node = tree.nodes.new("ShaderNodeBsdfDiffuse")
    node.inputs["Color"].default_value = (*colour, 1)
    node.inputs["Roughness"].default_value = 0.0
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def addPoint(position, intensity):
    """Radiant intensity per channel; Cycles takes watts: P = 4 pi I (measured: README.md)."""
    light = bpy.data.lights.new("point", "POINT")
    peak = max(intensity)
    light.energy, light.color = 4 * math.pi * peak, [i / peak for i in intensity]
    light.shadow_soft_size = 0.0
    light.cycles.max_bounces = 1024
    obj = bpy.data.objects.new("point", light)
    obj.location = position
    bpy.context.scene.collection.objects.link(obj)
    return obj


def addDirectional(directionToLight, irradiance):
    light = bpy.data.lights.new("sun", "SUN")
    peak = max(irradiance)
    light.energy, light.color = peak, [e / peak for e in irradiance]
    light.angle = 0.0
    light.cycles.max_bounces = 1024
    obj = bpy.data.objects.new("sun", light)
    obj.rotation_mode = "QUATERNION"
    obj.rotation_quaternion = mathutils.Vector(directionToLight).to_track_quat("Z", "Y")
    bpy.context.scene.collection.objects.link(obj)
    return obj


def setEnvironment(path):
    """None turns it off."""
    tree = bpy.context.scene.world.node_tree
    background = tree.nodes["Background"]
    for node in [n for n in tree.nodes if n.type == "TEX_ENVIRONMENT"]:
        tree.nodes.remove(node)
    if path is None:
        return
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = bpy.data.images.load(path, check_existing=True)
    node.image.colorspace_settings.name = "Non-Color"
    node.interpolation = "Linear"
    tree.links.new(node.outputs["Color"], background.inputs["Color"])


def addCamera(matrix, angleX=None, orthoWidth=None):
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    if orthoWidth:
        camera.type, camera.ortho_scale = "ORTHO", orthoWidth
    else:
        camera.angle_x = angleX
    camera.clip_start, camera.clip_end = 0.01, 1000.0
    obj = bpy.data.objects.new("camera", camera)
    obj.matrix_world = mathutils.Matrix([list(map(float, row)) for row in matrix])
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.scene.camera = obj
    return obj


def readImage(path):
    """(h, w, 4) float32, rows top to bottom, premultiplied as stored."""
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    w, h = image.size
    pixels = np.empty(w * h * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(h, w, 4)[::-1]


def renderTo(path):
    scene = bpy.context.scene
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


def render():
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "image.exr")
        renderTo(path)
        return readImage(path)
