"""Scenes to be mutated: the shipped ones, and some that hold most plugins between them."""

FRAME = """<scene version="3.0.0">
    <default name="width" value="12"/>
    <default name="height" value="12"/>
    <default name="spp" value="1"/>
    <default name="integrator" value="distribution"/>
    <integrator type="$integrator"><integer name="max_depth" value="4"/></integrator>
    <sensor type="{sensor}" id="camera">
        <float name="near_clip" value="0.01"/>
        <float name="far_clip" value="100"/>
        {lens}
        <transform name="to_world"><lookat origin="0.3, 1.8, 4.5" target="0, 0.6, 0" up="0, 1, 0"/></transform>
        <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <string name="pixel_format" value="rgb"/>
            <rfilter type="{rfilter}">{shape}</rfilter>
        </film>
    </sensor>
    <shape type="rectangle" id="floor">
        <transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform>
        <bsdf type="diffuse" id="grey"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf>
    </shape>
    {body}
</scene>"""
FILTERS = {
    "box": "",
    "tent": '<float name="radius" value="1"/>',
    "gaussian": '<float name="stddev" value="0.5"/>',
    "mitchell": '<float name="B" value="0.33"/><float name="C" value="0.33"/>',
    "catmullrom": "",
    "lanczos": '<integer name="lobes" value="3"/>',
}
PINHOLE = '<float name="fov" value="45"/>'
LENS = PINHOLE + '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4.5"/>'
LAMP = (
    '<shape type="rectangle" id="lamp"><transform name="to_world"><rotate x="1" angle="90"/>'
    '<scale x="0.7" z="0.4"/><translate x="0.5" y="2.5" z="1"/></transform>'
    '<emitter type="area"><rgb name="radiance" value="9, 8, 7"/></emitter></shape>'
)
CHECKS = (
    '<texture type="checkerboard" name="{}"><rgb name="color0" value="0.1, 0.2, 0.3"/>'
    '<rgb name="color1" value="0.7, 0.6, 0.5"/><transform name="to_uv"><scale x="4" y="3"/></transform></texture>'
)
BITMAP = (
    '<texture type="bitmap" name="{}"><string name="filename" value="sky.ppm"/><boolean name="raw" value="true"/>'
    "</texture>"
)


def balls(*bsdfs):
    """Spheres side by side, with a BSDF each, under the lamp."""
    x = (2.4 * (number + 0.5) / len(bsdfs) - 1.2 for number in range(len(bsdfs)))
    return LAMP + "".join(
        f'<shape type="sphere"><point name="center" x="{place:.2f}" y="0.6" z="0"/>'
        f'<float name="radius" value="0.3"/>{bsdf}</shape>'
        for place, bsdf in zip(x, bsdfs, strict=True)
    )


def scenes():
    """Return the XML of the scenes that are mutated, by name: those of the package and some with what they lack."""
    from whitted.scene import shipped, shipped_path

    rough = '<string name="distribution" value="beckmann"/><float name="alpha" value="0.2"/>'
    plastic = '<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.5, 0.3, 0.1"/></bsdf>'
    own = {
        "transmitting": ("perspective", PINHOLE, "box", balls(
            '<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>',
            f'<bsdf type="roughdielectric">{rough}<float name="int_ior" value="1.3"/></bsdf>',
            '<bsdf type="thindielectric"><string name="int_ior" value="bk7"/></bsdf>',
            '<bsdf type="null"/>',
        )),
        "reflecting": ("thinlens", LENS, "gaussian", balls(
            '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>',
            f'<bsdf type="roughconductor">{rough}<rgb name="eta" value="0.2"/><rgb name="k" value="4"/></bsdf>',
            f'<bsdf type="roughplastic">{rough}<boolean name="nonlinear" value="true"/></bsdf>',
            '<bsdf type="phong"><rgb name="diffuse_reflectance" value="0.6, 0.1, 0.1"/>'
            '<float name="specular_reflectance" value="0.3"/><float name="shininess" value="100"/></bsdf>',
        )),
        "layered": ("perspective", PINHOLE, "tent", balls(
            '<bsdf type="principled"><rgb name="base_color" value="0.8, 0.2, 0.1"/><float name="metallic" value="0.3"/>'
            '<float name="roughness" value="0.4"/><float name="spec_trans" value="0.2"/></bsdf>',
            '<bsdf type="principledthin"><float name="roughness" value="0.3"/><float name="diff_trans" value="0.7"/>'
            '<float name="eta" value="1.4"/></bsdf>',
            plastic,
            '<bsdf type="hair"><float name="eumelanin" value="0.3"/></bsdf>',
        )),
        "nested": ("perspective", PINHOLE, "mitchell", balls(
            f'<bsdf type="mask"><float name="opacity" value="0.4"/>{plastic}</bsdf>',
            f'<bsdf type="twosided">{plastic}<bsdf type="diffuse"/></bsdf>',
            '<bsdf type="blendbsdf"><float name="weight" value="0.3"/><bsdf type="diffuse"/>'
            '<bsdf type="twosided"><bsdf type="conductor"/></bsdf></bsdf>',
            f'<bsdf type="mask">{CHECKS.format("opacity")}<bsdf type="twosided"><bsdf type="phong"/></bsdf></bsdf>',
        )),
        "bumpy": ("perspective", PINHOLE, "catmullrom", balls(
            f'<bsdf type="bumpmap">{BITMAP.format("arbitrary")}<float name="scale" value="0.1"/>'
            f'<bsdf type="roughconductor">{rough}</bsdf></bsdf>',
            f'<bsdf type="normalmap">{BITMAP.format("normalmap")}<bsdf type="diffuse"/></bsdf>',
            f'<bsdf type="diffuse">{CHECKS.format("reflectance")}</bsdf>',
            f'<bsdf type="diffuse">{BITMAP.format("reflectance")}</bsdf>',
        )),
        "lights": ("perspective", PINHOLE, "lanczos", balls('<ref id="grey"/>', plastic)
            + '<emitter type="point"><point name="position" x="1" y="2" z="1"/><rgb name="intensity" value="5"/>'
            '</emitter><emitter type="spot"><transform name="to_world"><lookat origin="0, 3, 1" target="0, 0, 0"'
            ' up="0, 0, 1"/></transform><rgb name="intensity" value="9"/><float name="cutoff_angle" value="30"/>'
            '<float name="beam_width" value="20"/></emitter><emitter type="directional"><vector name="direction"'
            ' x="0.2" y="-1" z="-0.3"/><rgb name="irradiance" value="0.5"/></emitter><emitter type="constant">'
            '<rgb name="radiance" value="0.1, 0.2, 0.3"/></emitter><shape type="sphere"><point name="center" x="-1"'
            ' y="2" z="0"/><float name="radius" value="0.1"/><emitter type="area"><rgb name="radiance" value="30"/>'
            '</emitter></shape><shape type="disk"><transform name="to_world"><rotate y="1" angle="90"/><scale'
            ' value="0.2"/><translate x="-2" y="1"/></transform><emitter type="area">' + CHECKS.format("radiance")
            + "</emitter></shape>"),
        "environment": ("perspective", PINHOLE, "box", balls('<ref id="grey"/>', '<bsdf type="dielectric"/>')
            + '<emitter type="envmap"><string name="filename" value="sky.ppm"/><float name="scale" value="2"/>'
            '<transform name="to_world"><rotate y="1" angle="30"/></transform></emitter><emitter type="projector">'
            + BITMAP.format("irradiance") + '<float name="fov" value="40"/><transform name="to_world"><lookat'
            ' origin="0, 3, 2" target="0, 0, 0" up="0, 0, 1"/></transform></emitter>'),
        "daylight": ("orthographic", "", "gaussian", balls('<ref id="grey"/>', '<bsdf type="roughplastic"/>')
            + '<emitter type="sunsky"><float name="turbidity" value="3"/><float name="sun_scale" value="1"/>'
            '<vector name="sun_direction" x="0.3" y="0.5" z="0.8"/></emitter>'),
        "shapes": ("thinlens", LENS, "gaussian", LAMP
            + '<shape type="cylinder"><point name="p0" x="-1" y="0" z="0"/><point name="p1" x="-1" y="1" z="0.2"/>'
            '<float name="radius" value="0.2"/><ref id="grey"/></shape><shape type="disk"><transform name="to_world">'
            '<scale value="0.3"/><translate y="0.7"/></transform></shape><shape type="shapegroup" id="group">'
            '<shape type="sphere"><float name="radius" value="0.3"/><bsdf type="conductor"/></shape>'
            '<shape type="cube"><transform name="to_world"><scale value="0.1"/><translate y="0.4"/></transform></shape>'
            '</shape><shape type="instance"><ref id="group"/><transform name="to_world"><scale x="1" y="0.5" z="2"/>'
            '<rotate y="1" angle="30"/><translate x="0.6" y="0.5"/></transform></shape><shape type="instance">'
            '<ref id="group"/><transform name="to_world"><translate x="1.2" y="0.3" z="-1"/></transform></shape>'
            '<shape type="ply"><string name="filename" value="mesh.ply"/><ref id="grey"/></shape>'
            '<shape type="obj"><string name="filename" value="mesh.obj"/><boolean name="face_normals" value="true"/>'
            '<transform name="to_world"><translate x="-0.5" z="0.5"/></transform>'
            '<emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>'),
    }  # fmt: skip
    texts = {name: shipped_path(name).read_text(encoding="utf-8") for name in shipped()}
    for name, (sensor, lens, rfilter, body) in own.items():
        texts[name] = FRAME.format(
            sensor=sensor, lens=lens, rfilter=rfilter, shape=FILTERS[rfilter], body=body
        )
    return texts


def write_files(folder):
    """Write the files to which the scenes refer."""
    corners = ((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5))
    faces = ((0, 1, 2), (0, 1, 3), (0, 2, 3))
    lines = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + [f"element face {len(faces)}"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, corner)) for corner in corners]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    (folder / "mesh.ply").write_text("\n".join(lines) + "\n")
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    (folder / "sky.ppm").write_bytes(b"P6\n8 4\n255\n" + bytes(range(60, 156)))
