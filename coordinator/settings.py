"""Typed settings of all stages of tracking, with the presets `paper` and `default`.

They are stored with every result (`summary.json`), and the page docs/settings.md lists them. Each stage is
given its own struct. A quantity is in the unit that its name ends with: metres `_m`, square metres `_m2`,
seconds `_s`, degrees `_deg`, pixels `_px`, standard deviations `_deviations`, natural logarithms of a ratio
of likelihoods `_nats`. A `_share` and a `_probability` are from 0 to 1; all other numbers are counts.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from gepf.common.errors import InputError, check_choice
from gepf.common.settings import RefineSettings

Quantity = Annotated[float, msgspec.Meta(gt=0.0, lt=1e5)]
"""Metres, seconds, pixels, deviations, nats, or a ratio: larger than 0."""
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A part of a whole, or a probability."""
Degrees = Annotated[float, msgspec.Meta(gt=0.0, lt=180.0)]
Count = Annotated[int, msgspec.Meta(ge=1)]


class NoiseSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The noise of depth by distance z: floor + growth z^2, and how it is measured in a frame."""

    floor_m: Quantity = 0.001  #: standard deviation at any distance
    min_growth_m: Quantity = 0.0003  #: standard deviation added at 1 m: smallest value that is trusted
    max_growth_m: Quantity = 0.03  #: largest value that is trusted
    usual_growth_m: Quantity = 0.0015  #: value of typical depth cameras, used where none can be measured
    margin_deviations: Quantity = 4.0  #: differences below this are noise; 1 in 16 000 is larger
    outline_blur_px: Quantity = 4.0  #: radius over which a silhouette is blurred to remove its noise


class PlaneSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Floor and walls, by RANSAC."""

    points_across: Count = 80  #: points per row of the image
    samples: Count = 2_000  #: planes drawn, through three points each
    refined_samples: Count = 40  #: number of the best planes that are refined
    min_points: Count = 30  #: minimum number of points on a plane
    max_beyond_share: Share = 0.01  #: largest share of points behind a wall or below a floor
    max_camera_tilt_deg: Degrees = 50.0  #: largest tilt of the camera relative to the floor
    max_wall_tilt_deg: Degrees = 20.0  #: largest tilt of a wall from the vertical
    min_floor_width_m: Quantity = 0.2  #: smallest visible width of a floor
    min_floor_area_m2: Quantity = 0.3  #: smallest visible area of a floor
    min_wall_width_m: Quantity = 0.7  #: smallest visible width of a wall
    min_wall_area_m2: Quantity = 1.5  #: smallest visible area of a wall
    resting_height_m: Quantity = 0.3
    """Height above a floor at which the weight of a point, as evidence of something resting on it, is
    1 / e."""
    min_resting_share: Share = 0.1
    """Mean weight that another up direction must exceed if the usual one has no floor; points spread evenly
    up to 3 m have this weight."""
    outlier_percent: Quantity = 1.0  #: percentage of points at each end that an extent leaves out


class SegmentationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The pixels of a posed body."""

    near_m: Quantity = 0.12  #: distance from the surface; nearer foreground is the subject, and not learned
    cell_m: Quantity = 0.04  #: cell size of the distance field; body and room are not separated below it
    reach_cells: Count = 7  #: largest distance of the subject from the surface, in cells
    step_m: Quantity = 0.03  #: largest step in depth between neighbours on one surface, without noise
    min_person_m2: Quantity = 0.1  #: minimum visible area of a person; larger than that of any limb
    min_own_share: Share = 0.2
    """Smallest share of the pixels near a body that no other body explains; with less it is a duplicate."""
    beside_m: Quantity = 0.5  #: distance from a body within which other people and things are remembered
    beside_points: Count = 2_000  #: approximate number of their points that are remembered
    permanent_weight: Quantity = 0.1
    """Weight of an observed point on a surface that has been there all the time, and so may be furniture."""


class CandidateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What may be a person in the foreground; lengths and areas are scaled for bodies of other sizes."""

    person_m: Quantity = 1.7  #: extent of a person, for whom the lengths and areas below hold
    max_person_m2: Quantity = 1.6  #: largest visible area of a person
    max_joined_m2: Quantity = 6.0  #: largest visible area of a person together with flat furniture
    min_length_m: Quantity = 0.6  #: smallest length of a person in any pose
    max_length_m: Quantity = 2.5  #: largest length of a person; a frame that extends farther shows a room
    max_limb_step_m: Quantity = 0.8  #: largest step in depth from the outline of a body to its own limb
    same_spot_m: Quantity = 0.35  #: largest horizontal distance of a person's parts beside an occluder
    same_person_m: Quantity = 0.5  #: distance between the centres of one person as seen by two cameras
    min_part_m2: Quantity = 0.008  #: visible area of the smallest part of a person or of furniture
    max_flat_share: Share = 0.5  #: share of points in one plane above which an object is furniture
    flat_points: Count = 800  #: number of points of an object among which planes are searched for
    flat_samples: Count = 400  #: planes drawn by RANSAC, through three points each
    moved_permanence: Share = 0.9  #: permanence of a pixel below which something has moved there
    min_moved_m2: Quantity = 0.002  #: smallest area of such pixels, off the outline, that shows motion
    min_moved_share: Share = 0.2  #: share of a person's pixels with known background that shows motion


class SceneSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The known scene of a camera, and the people in front of it."""

    settled_s: Quantity = 1.0
    """Time after which a stationary nearer object becomes background; also the interval between searches for
    planes."""
    remembered_s: Quantity = 4.0  #: time for which what a pixel showed is remembered
    remember_interval_s: Quantity = 0.1  #: time between the images that are remembered
    noise: NoiseSettings = NoiseSettings()
    planes: PlaneSettings = PlaneSettings()
    segmentation: SegmentationSettings = SegmentationSettings()
    candidates: CandidateSettings = CandidateSettings()

    def scaled(self, smallest_m: float, largest_m: float) -> SceneSettings:
        """The settings for bodies from the smallest to the largest extent, in metres, that are not people."""
        segmentation, candidates = self.segmentation, self.candidates
        smallest = min(1.0, smallest_m / candidates.person_m)
        largest = largest_m / candidates.person_m
        return msgspec.structs.replace(
            self,
            segmentation=msgspec.structs.replace(
                segmentation, min_person_m2=smallest**2 * segmentation.min_person_m2
            ),
            candidates=msgspec.structs.replace(
                candidates,
                max_person_m2=largest**2 * candidates.max_person_m2,
                max_joined_m2=largest**2 * candidates.max_joined_m2,
                min_length_m=smallest * candidates.min_length_m,
                max_length_m=largest * candidates.max_length_m,
                min_part_m2=smallest**2 * candidates.min_part_m2,
            ),
        )


class GatingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether a pose explains a frame."""

    max_residual_m: Quantity = 0.03  #: mean distance of observed points, in addition to the camera's noise
    max_misfit_m: Quantity = 0.0235  #: root of the mean cost, which includes model surface in empty space
    min_points: Count = 150  #: minimum number of observed points that can show a body


class TrackSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a body is lost, searched for and checked, and which pixels may be its own."""

    lost_residual: Quantity = 1.3
    """Normalised residual above which a frame is not explained; usually below 1.2."""
    patience_s: Quantity = 0.1  #: time after which a body that explains no frame is lost
    search_interval_s: Quantity = 4 / 30
    """Interval between searches for an unknown body, and until a first check."""
    check_interval_s: Quantity = 1 / 3
    """Time between checks while the pose is doubtful, and between looks at candidates while colour has not
    confirmed a body."""
    max_searches: Count = 8  #: failed searches after which candidates are added to the background
    max_lookahead_s: Quantity = 0.06
    """Longest interval for looking ahead; in twice that time a walking person moves by `near_m`."""
    max_motion_m: Quantity = 0.8  #: largest motion of a body between two frames
    walking_m_per_s: Quantity = 1.0  #: growth of the standard deviation of a lost body's place
    room_m: Quantity = 3.0  #: largest standard deviation of a lost body's place
    gone_share: Share = 0.35
    """Share of the pixels in the last explained frame below which the body may have left."""
    whole_share: Share = 0.85  #: share of the pixels at its detection below which a part is missing
    camera_confirmed_s: Quantity = 0.5
    """Time after which a fault is reported, and after which cameras that agree are trusted."""


class ClothesSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The colours of clothes, from 0 to 1: who returns, and who is somebody else."""

    brightness_deviation: Quantity = 0.1
    """Standard deviation of the root of the brightness of one person's clothes, over light and posture."""
    hue_deviation: Quantity = 0.04  #: of red minus green and of yellow minus blue
    other_brightness_deviation: Quantity = 0.3  #: of the differences between two people's clothes
    other_hue_deviation: Quantity = 0.12  #: of the differences between two people's clothes
    hidden_odds: Quantity = 0.05  #: odds that something other than the clothes was seen
    memory_s: Quantity = 30.0  #: time over which the colour of clothes is averaged
    unlike_weight: Share = 0.3  #: least weight of a colour that is unlike those remembered
    unlike_nats: Quantity = 2.0  #: log odds for somebody else above which a person is not the one remembered
    unlike_s: Quantity = 1.0  #: time for which clothes must be unlike before the person is doubted


class ColourSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Keypoints in colour: how they are found, whose they are, and what follows from them."""

    min_presence: Share = 0.5  #: minimum probability that a crop shows a person
    visible_deviation_share: Share = 0.012
    """Standard deviation of a visible keypoint along each axis, in sides of the crop."""
    hidden_deviation_share: Share = 0.035  #: added if it is hidden (`python -m benchmarks.keypoints`)
    max_gap_px: Quantity = 12.0  #: largest width of gaps in registered colour that are closed
    reach_m: Quantity = 0.95  #: largest distance of an adult's body from the hips: half of a first crop
    outline_px: Count = 3  #: largest distance of a person's keypoints from the silhouette
    same_person_deviations: Quantity = 3.0  #: largest median distance of the keypoints of one person
    trunk_middle_m: Quantity = 0.08  #: radius across the line of sight in which the trunk's depth is measured
    hand_share: Share = 0.1  #: share of the surface within `trunk_middle_m` that may be nearer than the trunk
    looks_per_s: Quantity = 40.0  #: candidates looked at per second: half of the time of a processor core
    late_look_s: Quantity = 0.5  #: time between looks while live frames are late
    max_step_s: Quantity = 0.5
    """Cap on how much the interval between two frames adds to a time measured by colour."""
    facing_s: Quantity = 1.0
    """Time for which colour must show left and right correctly before it decides between front and back."""
    exchanged_s: Quantity = 4.0
    """Time for which colour must show left and right swapped before depth is doubted."""
    unshown_s: Quantity = 1.0  #: time after which a new body that colour has not confirmed is dropped
    persistent_s: Quantity = 4.0
    """Time by which disagreement must exceed agreement before colour is no longer used."""
    shifted_deviations: Quantity = 1.5
    """Largest median offset of all keypoints; for real people it is 0.8, and rarely more."""
    clothes: ClothesSettings = ClothesSettings()


class SearchSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The stages of a search for a body."""

    library_poses: Count = 3_000  #: number of poses that are compared with the frame
    library_vertices: Count = 1_700  #: vertices of the surface; enough to fill the cells of a descriptor
    max_cell_difference: Quantity = 4.0
    """Cap on the depth difference of two descriptors in a cell, in cells; also the difference of an empty
    cell."""
    min_upright_share: Share = 0.3  #: cosine of the camera's pitch below which no direction is upright
    candidates: Count = 100  #: candidates in the first orientation
    further_candidates: Count = 15  #: candidates in each other orientation, and for each wider mask
    points: Count = 1_000  #: number of points on which the first candidates are refined
    rough_iterations: Count = 3  #: iterations of the first candidates
    rough_kept: Count = 16  #: distinct candidates that remain
    iterations: Count = 12  #: iterations until they converge; the last stage has half of these
    kept: Count = 4  #: distinct candidates that remain after these iterations
    recombined: Count = 2  #: number of candidates into which limbs of other candidates are swapped
    request_iterations: Count = 150  #: iterations in one request: about 10 ms on one lane
    distinct_m: Quantity = 0.05  #: mean distance of the joints below which candidates are the same
    surer_nats: Quantity = 1.0  #: margin by which a detection must explain a frame better than the track
    alike_nats: Quantity = 2.0  #: minimum difference that distinguishes two poses
    end_m: Quantity = 0.06  #: width of a person's outermost strip on each side: one cell of a descriptor
    cut_gap_m: Quantity = 0.03  #: largest distance in the image between a person and what truncates them
    cut_share: Share = 0.5  #: share of that strip that must be truncated for the side to count as truncated


class FeatureWeights(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Log odds that a joint is wrong, for each unit of a feature, see `coordinator/tracking/certainty.py`."""

    seen: float = -4.436  #: visible share of the surface around the joint
    residual: float = 3.288  #: normalised residual of the body
    unexplained: float = 0.4479
    """Logarithm of the share of the points within reach of the joint that no surface explains."""
    spread: float = 0.1229  #: logarithm of the spread of the hypotheses
    speed: float = 0.2606  #: logarithm of the joint's speed
    bend: float = 0.1967  #: sum of the squared angles above the joint
    folding: float = 2.4  #: folding of the body
    crowding: float = 0.9285  #: number of joints nearby
    protrusion: float = 4.54  #: distance in front of or behind the mean joint


class CertaintyFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Log odds that a joint is wrong, linear in its features, and its deviation, a function of them.

    Fitted by `python -m benchmarks.certainty --fit`.
    """

    intercept: float = -0.7709  #: log odds
    weights: FeatureWeights = FeatureWeights()
    log_deviation: float = -1.704  #: logarithm of the deviation in metres
    log_deviation_odds: float = 0.2992  #: change of that logarithm per unit of the log odds
    log_deviation_hidden: float = 0.15  #: change of that logarithm with the hidden share


class CertaintySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The certainty of each joint, and the status of a frame."""

    wrong_m: Quantity = 0.15  #: distance from the true joint beyond which an estimate is wrong
    flagged_probability: Share = 0.04
    """Probability of being wrong above which a joint is flagged; 4 to 9 % of the correct joints are
    flagged."""
    ambiguous_probability: Share = 0.15  #: probability of a wrong joint above which the frame is ambiguous
    out_of_view_nats: float = 1.0
    """Log odds added for a joint out of view, over one that the body hides; fitted to people truncated at the
    hips."""
    shown_nats: Quantity = 2.0
    """Log odds subtracted for a joint that colour confirms; 4 fits rendered people."""
    max_nats: Quantity = 10.0  #: largest log odds; there are no measurements beyond
    spread_floor_m: Quantity = 0.005  #: added to the spread of hypotheses before the logarithm
    speed_floor_m_s: Quantity = 0.1  #: added to the speed before the logarithm; metres per second
    crowded_m: Quantity = 0.2  #: standard deviation of the weight of neighbouring joints by distance
    region_m: Quantity = 0.12  #: standard deviation of the weight of the surface around a joint by distance
    agrees_m: Quantity = 0.08  #: largest difference between the surface and the depth measured there
    aside_m: Quantity = 0.03  #: radius across the line of sight in which measured depth is searched for
    reach_m: Quantity = 0.25  #: standard deviation of the weight of unexplained points around a joint
    unexplained_m: Quantity = 0.05  #: distance from the surface beyond which a point is unexplained
    share_floor: Quantity = 0.003  #: added to the share of unexplained points before the logarithm
    hidden_share: Share = 0.5  #: visible share below which a joint is hidden
    rival_share: Share = 0.5  #: minimum weight of a rival, relative to the most likely hypothesis
    information: Quantity = 44.0
    """Factor on the information of the points if the shape is known; fitted to rendered robots with a
    Kinect's noise."""
    max_hypotheses: Count = 100  #: largest number of hypotheses in an estimate, the most likely ones
    fit: CertaintyFit = CertaintyFit()


class ExplorationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Proposals for single limbs."""

    min_particles: Count = 8
    """Particles in a frame that the prediction explains; with 6 or 7, a hidden arm is lost in one or two of
    ten runs, with 8 and 20 in none."""
    late_particles: Count = 4  #: particles in a live frame that is late, at most
    data_driven_share: Share = 0.4  #: share of the particles that are moved to observed points
    vertices: Count = 400  #: vertices of the body that are compared with observed points
    near_m: Quantity = 0.08  #: largest distance of an explained point from a vertex
    max_unexplained_share: Share = 0.05
    """Share of unexplained points above which all particles are used; 2 to 10 % work equally well."""
    draws: Count = 80  #: draws per limb; twice as many do not explain more points


class FilterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Steps 1-3, 6 and 7 of the filter."""

    particles: int = 20  #: number of particles; for `annealed`, per layer
    merge_angle_deg: float = 4.0  #: d; with `explore` covariances decide, unless correspondences are soft
    velocity_time_s: float | None = None  #: time in which a velocity decays to 1 / e; None: never
    explore: bool = False  #: whether to propose single limbs, see coordinator/filters/exploration.py
    early_share: Share = 0.0
    """With `explore` and more iterations than at 30 frames per second, share of them after which particles
    are merged for the first time. The representatives are then refined with all iterations. With 0, particles
    are merged only once."""
    min_early_weight: Share = 0.01  #: weight, relative to the largest, below which a mode is then dropped
    merge_variances: Quantity = 2.0 / 3.0  #: squared Mahalanobis distance per degree of freedom
    reduction_share: Share = 0.1  #: share by which step 7 reduces every covariance in each frame
    first_deviation_m: Quantity = 0.02  #: standard deviation of the initial values of prismatic joints
    usual_speed_m_s: Quantity = 1.8  #: root mean square over the joints; metres per second
    unexpected_turn_deg: Degrees = 15.0  #: deviation of a joint from its prediction after a usual interval
    exploration: ExplorationSettings = ExplorationSettings()


class ShapeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The shape of a body, estimated over time."""

    error_time_s: Quantity = 1.0  #: time within which successive frames are assumed to share one shape error
    curvature_share: Share = 0.1
    """Share of the Gauss-Newton information that counts: with more, a wrong first stature of rendered people
    was not corrected, and deviations were too small."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that determines the results of a run, apart from the input."""

    preset: str = "default"  #: `default` or `paper` (Grest and Krueger, 2007): values chosen together
    method: str = "gepf"  #: a key of `METHODS` in `coordinator/filters/methods.py`
    seed: int = 0  #: seed of all random numbers
    points: int = 10_000  #: largest number of observed points, under usual noise
    soft_points_factor: Quantity = 1.0
    """Factor on `points` under heavy noise (soft correspondences): then each point adds information; under
    usual noise the body's shape limits the accuracy."""
    measure_noise: bool = True
    """Whether to measure the camera's noise in the first frame; the noise in `refine` is the minimum."""
    pace_iterations: float = 0.0  #: growth of iterations with the time between frames
    max_pace: Quantity = 3.0  #: the largest factor on the iterations is `max_pace ** pace_iterations`
    measure_person: bool = True  #: whether to estimate the stature, from the first frames that show a person
    recover: bool = True  #: whether to redetect the body if it is lost or in doubt
    rotate_deg: int | None = None  #: clockwise rotation that makes a person upright; None to estimate it
    refine: RefineSettings = RefineSettings()
    filter: FilterSettings = FilterSettings()
    shape: ShapeSettings = ShapeSettings()
    scene: SceneSettings = SceneSettings()
    search: SearchSettings = SearchSettings()
    gating: GatingSettings = GatingSettings()
    track: TrackSettings = TrackSettings()
    colour: ColourSettings = ColourSettings()
    certainty: CertaintySettings = CertaintySettings()


PRESETS = {
    "default": Settings(
        preset="default",
        points=3_000,
        soft_points_factor=3.0,
        pace_iterations=2.0,
        refine=RefineSettings(
            icp_iterations=4,
            descent="accelerated",
            sensor="camera",
            likelihood_scale=0.004,
            pose_deviation=1.6,
        ),
        filter=FilterSettings(velocity_time_s=0.05, explore=True, early_share=0.5),
    ),
    "paper": Settings(preset="paper", measure_person=False, recover=False),
}


def preset(name: str) -> Settings:
    """Settings of a preset; InputError lists the valid ones."""
    check_choice("preset", name, PRESETS)
    return PRESETS[name]


def check_settings(settings: Settings) -> None:
    """InputError that names the setting for a value of a wrong type, or out of its range."""
    try:
        msgspec.convert(msgspec.to_builtins(settings), Settings)
    except msgspec.ValidationError as error:
        what, _, place = str(error).rpartition(" - at ")
        raise InputError(f"setting {place.strip('`$.')} is not valid: {what[:1].lower()}{what[1:]}") from None
