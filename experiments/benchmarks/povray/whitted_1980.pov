// The scene of scenes/whitted_1980.xml for POV-Ray 3.7, number by number, to compare speed on equal work.
//
// The same: camera, geometry, indices of refraction, point light with its falloff, checker, sky colour, black shadows
// under the glass, depth of the ray tree, cutoff.
// Another: the sky lights the floor by the constant `ambient`, as if nothing hid any of it, at no cost in rays; our
// scene spends a shadow ray on it. The highlights are Blinn's, ours are Beckmann's, of the same width and height. Rays go
// through the centres of pixels; ours are spread over them.

#version 3.7;

#declare SKY = rgb <0.07, 0.13, 0.40>;
#declare LIGHT = <-300, 900, 800>;
#declare INTENSITY = 5400000;
#declare ALPHA = 0.035;
#declare HIGHLIGHT = 0.006 / (4 * ALPHA * ALPHA * 0.91); // as high as ours, at the angle in which they are seen

global_settings {
    assumed_gamma 1.0
    max_trace_level 8      // max_depth: the longest chain has 8 rays in both; here the hits of the 8th are lit, too
    adc_bailout 1/1024     // min_contribution
    ambient_light SKY
}

// `ambient 1`: a diffuse surface under a sky of radiance L has the radiance reflectance * L
#default { finish { ambient 0 diffuse 0 } }

background { color SKY }

// A negative `right` makes the coordinates right-handed, as Mitsuba's
camera {
    perspective
    location <0, 2.7, 9>
    up y
    right -x
    angle 48
    look_at <0.15, 1.75, 0>
}

// POV-Ray shades with colour * reflectance * cos / r^p, p = 2 where fade_power is 2: colour * 2 / (1 + (r/d)^2) with
// d = fade_distance = 1, next to 2 colour / r^2 as r > 1000. Ours is intensity / (pi r^2).
light_source {
    LIGHT
    color rgb INTENSITY / (2 * pi)
    fade_distance 1
    fade_power 2
}

#declare OUTSIDE = sphere { <-0.35, 2.35, 2.2>, 1.15 }
#declare INSIDE = sphere { <-0.35, 2.35, 2.2>, 1.06 }
#declare CLEAR = texture {
    pigment { color rgbt <1, 1, 1, 1> }
    finish { reflection { 0, 1 fresnel on } conserve_energy specular HIGHLIGHT roughness ALPHA * ALPHA / 2 }
}

// Declare=CSG=0 traces a quarter faster, but POV-Ray takes the Fresnel terms of the inner sphere from its n = 1 alone,
// and so has no reflection there; by CSG the shell is right
#ifndef (CSG)
    #declare CSG = 1;
#end

#if (CSG)
    difference {
        object { OUTSIDE }
        object { INSIDE }
        texture { CLEAR }
        interior { ior 1.5 }
        no_shadow
    }
#else
    object {
        OUTSIDE
        texture { CLEAR }
        interior { ior 1.5 }
        no_shadow
    }
    object {
        INSIDE
        texture { CLEAR }
        interior { ior 1.0 }
        no_shadow
    }
#end

// Nothing but the shadow of the glass: POV-Ray would let light straight through
object {
    OUTSIDE
    pigment { color rgb 0 }
    no_image
    no_reflection
}

sphere {
    <1.35, 1.45, -0.6>, 1.25
    pigment { color rgb 0 }
    finish { reflection { rgb 0.85 } specular 0.85 * HIGHLIGHT roughness ALPHA * ALPHA / 2 }
}

// Squares of side 1; moved down by a hair, so that the plane lies within one layer of POV-Ray's checkered cubes
plane {
    y, 0
    pigment { checker color rgb <0.80, 0.66, 0.06> color rgb <0.62, 0.045, 0.03> translate -0.001 * y }
    finish { ambient 1 diffuse 1 }
}
