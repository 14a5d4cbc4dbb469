"""Gestures of an operator as values, free of browser and meaning."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

from ui.review.check_gestures import LONGEST_NAME, REVIEWING, Reviewed
from ui.review.drawing import MaskDrawn, mask_from_message
from ui.review.mark_gestures import MARKING, MarkGesture
from ui.review.mosaic import (
    MosaicPicked,
    NearAsked,
    SeamDrawn,
    area_of,
    near_from_message,
    picked_from_message,
    seam_from_message,
)
from ui.review.sight import Outlined, outlined_from_message, ray_of
from ui.review.state import (
    KINDS,
    LAYERS,
    RELIEFS,
    SHEETS,
    SORT_COLUMNS,
    STATE_FILTERS,
    Key,
    QueueFilter,
    Sheet,
    SortColumn,
)

Verdict = Literal["accept", "reject", "dubious", "invisible"]
Aim = Literal["pick", "hover", "follow"]
VERDICTS: tuple[Verdict, ...] = ("accept", "reject", "dubious", "invisible")


@dataclass(frozen=True, slots=True)
class Judged:
    """A verdict on one measurement, with the key it was aimed at: the hand may be ahead."""

    seat_id: str
    key: Key
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class JudgedTogether:
    """One verdict on several measurements at once."""

    seat_id: str
    keys: tuple[Key, ...]
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Dropped:
    """The draft about a measurement given up."""

    seat_id: str
    key: Key


@dataclass(frozen=True, slots=True)
class Explained:
    """The reason of the rejection just made, as a digit."""

    seat_id: str
    digit: int


@dataclass(frozen=True, slots=True)
class PlacedInScan:
    """The point drafted by hand, in pixels of the raw scan; a new one where the key has no name."""

    seat_id: str
    key: Key
    column: float
    row: float


@dataclass(frozen=True, slots=True)
class PlacedOnGround:
    """The point drafted by hand in the rectified scan: easting and northing, metres."""

    seat_id: str
    key: Key
    east: float
    north: float


@dataclass(frozen=True, slots=True)
class Refined:
    """The measurement drafted on the peak of likeness beside it."""

    seat_id: str
    key: Key


@dataclass(frozen=True, slots=True)
class PeakChosen:
    """Another of the places the engine found, drafted."""

    seat_id: str
    key: Key
    index: int


@dataclass(frozen=True, slots=True)
class RoleSwitched:
    """Control becomes check, check becomes control."""

    seat_id: str
    point_id: str


@dataclass(frozen=True, slots=True)
class Undone:
    """What was done last is taken back: a draft, or a decision."""

    seat_id: str
    mark: Key | None = None
    """Photo and name of the fiducial that the board shows."""
    asked: bool = False
    """Whether it answers what was asked before something weighty is taken back."""


@dataclass(frozen=True, slots=True)
class Redone:
    """The last withdrawal is taken back."""

    seat_id: str


@dataclass(frozen=True, slots=True)
class Stepped:
    """Next or previous in the queue."""

    seat_id: str
    step: int
    undecided: bool = False
    """True to pass over what is decided already."""


@dataclass(frozen=True, slots=True)
class Selected:
    """One measurement picked in the queue or among the thumbnails."""

    seat_id: str
    key: Key


@dataclass(frozen=True, slots=True)
class Sorted:
    """The queue ordered anew."""

    seat_id: str
    column: SortColumn
    descending: bool


@dataclass(frozen=True, slots=True)
class Filtered:
    """The queue filtered anew."""

    seat_id: str
    wanted: QueueFilter


@dataclass(frozen=True, slots=True)
class Aimed:
    """The pointer in the 3D scene: a ray in the local frame, and what the hand did there."""

    seat_id: str
    act: Aim
    """`pick`: a click; `hover`: the pointer rests; `follow`: a double click, into a photo, out of
    it, or what sees a place."""
    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    number: int = 0
    """The page's own number of the question, so that it knows the answer again."""


@dataclass(frozen=True, slots=True)
class PhotoEntered:
    """The eye goes into a photo's perspective centre, or out again without a name."""

    seat_id: str
    photo_id: str


@dataclass(frozen=True, slots=True)
class ReliefRaised:
    """Heights drawn larger than they are."""

    seat_id: str
    relief: float


@dataclass(frozen=True, slots=True)
class ThemeChosen:
    """The page is light, or dark again."""

    seat_id: str
    light: bool


@dataclass(frozen=True, slots=True)
class LayerSwitched:
    """A layer of the 3D scene shown or hidden."""

    seat_id: str
    layer: str
    shown: bool
    rays: int = 0
    """Of tie points only those of so many photos; all of them when 0."""


@dataclass(frozen=True, slots=True)
class VectorsScaled:
    """Residual vectors drawn longer or shorter."""

    seat_id: str
    scale: float


@dataclass(frozen=True, slots=True)
class Fitted:
    """The 3D view shall show the whole block, or what is current."""

    seat_id: str
    whole: bool


@dataclass(frozen=True, slots=True)
class RemakeAsked:
    """Make the stale orthos again."""

    seat_id: str


@dataclass(frozen=True, slots=True)
class RemakeCancelled:
    """Stop making orthos, or searching marks."""

    seat_id: str
    filling: bool = False


@dataclass(frozen=True, slots=True)
class PointAsked:
    """A new point, clicked in the ortho: to be found in every scan."""

    seat_id: str
    east: float
    north: float


@dataclass(frozen=True, slots=True)
class TakenBack:
    """One decision of the history taken back, or decided again."""

    seat_id: str
    decision_id: int
    again: bool = False


@dataclass(frozen=True, slots=True)
class Named:
    """The operator says who it is."""

    seat_id: str
    name: str


@dataclass(frozen=True, slots=True)
class QualityAsked:
    """The view of the block's quality opened or closed."""

    seat_id: str
    shown: bool
    pair: tuple[int, int] | None = None
    """Numbers of two adjustments to compare."""


@dataclass(frozen=True, slots=True)
class SheetAsked:
    """The fiducial board or the map of placements opened or closed."""

    seat_id: str
    sheet: Sheet
    shown: bool


@dataclass(frozen=True, slots=True)
class AnswerAsked:
    """The page is to be told when everything it sent before is done."""

    seat_id: str
    number: int


@dataclass(frozen=True, slots=True)
class Freed:
    """What the adjustment estimates from now on."""

    seat_id: str
    cameras: bool
    robust: bool


SceneGesture = LayerSwitched | VectorsScaled | ReliefRaised | PhotoEntered | ThemeChosen
Looking = (
    Stepped | Selected | Sorted | Filtered | Aimed | SceneGesture | Fitted | QualityAsked
    | SheetAsked | AnswerAsked | MosaicPicked | NearAsked | Outlined
)  # fmt: skip
Gesture = (
    Looking | Judged | JudgedTogether | Dropped | Explained
    | PlacedInScan | PlacedOnGround | Refined | PeakChosen | RoleSwitched | Undone | Redone
    | RemakeAsked | RemakeCancelled | PointAsked | TakenBack | Named | Freed
    | MarkGesture | MaskDrawn | Reviewed
    | SeamDrawn
)  # fmt: skip
LOOKING: tuple[type, ...] = get_args(Looking)
"""What a guest may do: look at everything, change nothing that others see."""
Message = Mapping[str, Any]


def gesture_from_message(seat_id: str, message: Message) -> Gesture | None:
    """The gesture a page reports; None when it is none we know or is not well formed."""
    reader = _READERS.get(str(message.get("kind", "")))
    if reader is None:
        return None
    try:
        return reader(seat_id, message)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError):
        return None


def _key(message: Message) -> Key:
    point_id, photo_id = cast(list[Any], message["key"])
    return str(point_id), str(photo_id)


def _judged(seat_id: str, message: Message) -> Gesture:
    verdict = message["verdict"]
    if verdict not in VERDICTS:
        raise ValueError(verdict)
    if "keys" not in message:
        return Judged(seat_id, _key(message), verdict)
    keys = tuple(_key({"key": key}) for key in cast(list[Any], message["keys"]))
    return JudgedTogether(seat_id, keys, verdict)


def _placed(seat_id: str, message: Message) -> Gesture:
    first, second = (float(value) for value in message["place"])
    if not (abs(first) < 1e9 and abs(second) < 1e9):
        raise ValueError("not a place")
    if message.get("frame") == "scan":
        return PlacedInScan(seat_id, _key(message), first, second)
    return PlacedOnGround(seat_id, _key(message), first, second)


def _sorted(seat_id: str, message: Message) -> Gesture:
    if message["column"] not in SORT_COLUMNS:
        raise ValueError(message["column"])
    return Sorted(seat_id, message["column"], bool(message["descending"]))


def _filtered(seat_id: str, message: Message) -> Gesture:
    if message["state"] not in STATE_FILTERS or message["role"] not in ("", *KINDS):
        raise ValueError(message["state"])
    photo, role, text = (str(message.get(name, "")) for name in ("photo", "role", "text"))
    return Filtered(seat_id, QueueFilter(message["state"], photo, role, text, area_of(message)))


def _layer(seat_id: str, message: Message) -> Gesture:
    if message["layer"] not in LAYERS:
        raise ValueError(message["layer"])
    return LayerSwitched(
        seat_id, message["layer"], bool(message["shown"]), int(message.get("rays", 0))
    )


def _scaled(seat_id: str, message: Message) -> Gesture:
    return VectorsScaled(seat_id, min(max(float(message["scale"]), 0.0), 1000.0))


def _raised(seat_id: str, message: Message) -> Gesture:
    relief = float(message["relief"])
    if relief not in RELIEFS:
        raise ValueError(message["relief"])
    return ReliefRaised(seat_id, relief)


def _aimed(act: Aim) -> Callable[[str, Message], Gesture]:
    """Reads a ray of the scene."""

    def read(seat_id: str, message: Message) -> Gesture:
        return Aimed(seat_id, act, *ray_of(message["ray"]), int(message["number"]))

    return read


def _asked(seat_id: str, message: Message) -> Gesture:
    east, north = (float(value) for value in message["place"])
    if not (abs(east) < 1e9 and abs(north) < 1e9):
        raise ValueError("not a place")
    return PointAsked(seat_id, east, north)


def _named(seat_id: str, message: Message) -> Gesture:
    name = " ".join("".join(c for c in str(message["name"]) if c.isprintable()).split())
    if not name:
        raise ValueError("no name")
    return Named(seat_id, name[:LONGEST_NAME])


def _quality(seat_id: str, message: Message) -> Gesture:
    pair = message.get("pair")
    chosen = None if pair is None else (int(pair[0]), int(pair[1]))
    return QualityAsked(seat_id, bool(message["shown"]), chosen)


def _sheet(seat_id: str, message: Message) -> Gesture:
    if message["sheet"] not in SHEETS:
        raise ValueError(message["sheet"])
    return SheetAsked(seat_id, message["sheet"], bool(message["shown"]))


_READERS: dict[str, Callable[[str, Message], Gesture]] = {
    "judge": _judged,
    "drop": lambda seat, message: Dropped(seat, _key(message)),
    "explain": lambda seat, message: Explained(seat, int(message["digit"])),
    "place": _placed,
    "refine": lambda seat, message: Refined(seat, _key(message)),
    "peak": lambda seat, message: PeakChosen(seat, _key(message), int(message["index"])),
    "role": lambda seat, message: RoleSwitched(seat, str(message["point"])),
    "undo": lambda seat, message: Undone(
        seat, _key(message) if "key" in message else None, bool(message.get("asked"))
    ),
    "redo": lambda seat, message: Redone(seat),
    "step": lambda seat, message: Stepped(
        seat, 1 if int(message["step"]) > 0 else -1, bool(message.get("undecided", False))
    ),
    "select": lambda seat, message: Selected(seat, _key(message)),
    "sort": _sorted,
    "filter": _filtered,
    "outline": outlined_from_message,
    "layer": _layer,
    "vectors": _scaled,
    "relief": _raised,
    "theme": lambda seat, message: ThemeChosen(seat, bool(message["light"])),
    "hover": _aimed("hover"),
    "click": _aimed("pick"),
    "follow": _aimed("follow"),
    "enter": lambda seat, message: PhotoEntered(seat, str(message["photo"])),
    "fit": lambda seat, message: Fitted(seat, bool(message.get("whole", True))),
    "remake": lambda seat, message: RemakeAsked(seat),
    "add": _asked,
    "back": lambda seat, message: TakenBack(
        seat, int(message["decision"]), bool(message.get("again"))
    ),
    "name": _named,
    "quality": _quality,
    "free": lambda seat, message: Freed(seat, bool(message["cameras"]), bool(message["robust"])),
    "sheet": _sheet,
    **MARKING,
    "draw": mask_from_message,
    "pick": picked_from_message,
    "near": near_from_message,
    **REVIEWING,
    "seam": seam_from_message,
    "cancel": lambda seat, message: RemakeCancelled(seat, bool(message.get("filling", False))),
    "answer": lambda seat, message: AnswerAsked(seat, int(message["number"])),
}
