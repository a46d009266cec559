"""Kernels of :mod:`core.geometry.spatial_warp`. The mesh is centred at the origin and has unit extent."""

import warp as wp

# Barycentric units; rays along the edge between two triangles must not pass between them by rounding.
EDGE = wp.constant(wp.float64(1e-12))
FAR = wp.constant(wp.float32(1e18))  # its square is still a float32


@wp.func
def _on_segment(a: wp.vec3d, b: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    along = b - a
    squared = wp.dot(along, along)
    share = wp.float64(0.0)
    if squared > wp.float64(0.0):
        share = wp.clamp(wp.dot(point - a, along) / squared, wp.float64(0.0), wp.float64(1.0))
    return a + along * share


@wp.func
def _nearer(a: wp.vec3d, b: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    if wp.length_sq(a - point) < wp.length_sq(b - point):
        return a
    return b


@wp.func
def _on_triangle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    """The point's foot on the plane where that is inside, else the nearest on an edge; a sliver is its edges."""
    foot = _nearer(_on_segment(a, b, point), _on_segment(b, c, point), point)
    foot = _nearer(_on_segment(c, a, point), foot, point)
    normal = wp.cross(b - a, c - a)
    squared = wp.dot(normal, normal)
    if squared > wp.float64(0.0):
        v = wp.dot(wp.cross(point - a, c - a), normal) / squared
        w = wp.dot(wp.cross(b - a, point - a), normal) / squared
        if v >= wp.float64(0.0) and w >= wp.float64(0.0) and v + w <= wp.float64(1.0):
            foot = _nearer(a + (b - a) * v + (c - a) * w, foot, point)
    return foot


@wp.func
def _single(vector: wp.vec3d) -> wp.vec3f:
    return wp.vec3f(wp.float32(vector[0]), wp.float32(vector[1]), wp.float32(vector[2]))


@wp.kernel
def closest(
    mesh: wp.uint64,
    tree: wp.uint64,
    corners: wp.array2d[wp.vec3d],
    points: wp.array[wp.vec3d],
    slack: wp.float32,
    nearest: wp.array[wp.vec3d],
    faces: wp.array[wp.int32],
) -> None:
    """Nearest of the triangles that intersect the sphere around the point through float32's nearest one."""
    i = wp.tid()
    point = points[i]
    face = wp.int32(0)  # warp passes slivers over; where there is nothing else, any triangle gives the sphere
    rough = wp.mesh_query_point_no_sign(mesh, _single(point), FAR)
    if rough.result:
        face = rough.face
    best = _on_triangle(corners[face, 0], corners[face, 1], corners[face, 2], point)
    radius = wp.float32(wp.length(best - point))
    query = wp.bvh_query_sphere(tree, _single(point), radius + (radius + wp.float32(1.0)) * slack)
    other = wp.int32(0)
    while wp.bvh_query_next(query, other):
        foot = _on_triangle(corners[other, 0], corners[other, 1], corners[other, 2], point)
        difference = wp.length_sq(foot - point) - wp.length_sq(best - point)
        # Among equals the first, so that the answer does not depend on the order in which the tree is walked.
        if difference < wp.float64(0.0) or (difference == wp.float64(0.0) and other < face):
            best = foot
            face = other
    nearest[i] = best
    faces[i] = face


@wp.kernel
def first_hit(
    tree: wp.uint64,
    corners: wp.array2d[wp.vec3d],
    origins: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3d],
    slack: wp.float32,
    hides: wp.array[wp.uint8],
    eye: wp.int32,
    distances: wp.array[wp.float64],
    faces: wp.array[wp.int32],
) -> None:
    """Moeller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997; ``directions`` have length 1.

    The volume is negative where the ray meets the back of a triangle. From an ``eye`` at the ray's origin (1) or at its
    far end (-1) a triangle may not occlude at all (2), or not from behind (1); without one (0) all are hit.
    """
    i = wp.tid()
    origin = origins[i]
    direction = directions[i]
    face = wp.int32(-1)
    best = wp.float64(wp.inf)
    # From where the ray comes near the mesh: float32 is too coarse for an origin far away.
    skipped = wp.max(-wp.dot(origin, direction) - wp.float64(2.0), wp.float64(0.0))
    reach = wp.float32(wp.inf)
    query = wp.bvh_query_ray(tree, _single(origin + direction * skipped), _single(direction))
    other = wp.int32(0)
    while wp.bvh_query_next(query, other, reach):
        a = corners[other, 0]
        ab = corners[other, 1] - a
        ac = corners[other, 2] - a
        across = wp.cross(direction, ac)
        volume = wp.dot(ab, across)
        passed = eye != 0 and hides[other] == wp.uint8(2)
        if hides[other] == wp.uint8(1) and volume * wp.float64(eye) < wp.float64(0.0):
            passed = True
        if volume != wp.float64(0.0) and not passed:
            offset = origin - a
            v = wp.dot(offset, across) / volume
            around = wp.cross(offset, ab)
            w = wp.dot(direction, around) / volume
            distance = wp.dot(ac, around) / volume
            inside = v >= -EDGE and w >= -EDGE and v + w <= wp.float64(1.0) + EDGE
            nearer = distance < best or (distance == best and other < face)
            if inside and distance >= wp.float64(0.0) and nearer:
                best = distance
                face = other
                reach = wp.float32(distance - skipped) + wp.float32(4.0) * slack
    distances[i] = best
    faces[i] = face
