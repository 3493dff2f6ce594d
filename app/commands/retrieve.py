"""`gearcase retrieve FILE`: the nearest cases of a recording; nothing is stored."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.table import Table

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, Json, Steady, frame_of
from app.recordings.intake import decoded, hear, media_type_of
from app.recordings.metadata import RecordingMetadata
from app.recordings.neighbours import MOST_NEIGHBOURS, NeighbourAnswer, NeighbourQuery, RetrievalAnswer, neighbours_of
from signals.features import feature_words

SHOWN_FEATURES = 3


def register(app: typer.Typer) -> None:
    app.command("retrieve")(retrieve)


def retrieve(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="sound file: WAV, FLAC, phone formats")],
    k: Annotated[int, typer.Option("--k", min=1, max=MOST_NEIGHBOURS, metavar="N", help="how many cases")] = 5,
    representation: Annotated[
        Literal["full", "paper"], typer.Option(help="all features, or FFT bands and crest factors as in the paper")
    ] = "full",
    weight: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="of a feature, or of all whose names begin so; may come again"),
    ] = None,
    label: Annotated[
        list[str] | None, typer.Option(metavar="LABEL", help="only cases with this label; may come again")
    ] = None,
    origin: Annotated[Literal["measured", "simulated"] | None, typer.Option(help="only such cases")] = None,
    of_axis: Annotated[list[str] | None, typer.Option(metavar="NAME", help="only cases of this axis")] = None,
    of_gearbox: Annotated[list[str] | None, typer.Option(metavar="NAME", help="only cases of this gearbox")] = None,
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=MEANT)] = None,
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    period: Annotated[float | None, typer.Option(help="one full cycle of the motion [s]")] = None,
    steady: Steady = None,
    channel: Annotated[int | None, typer.Option(help="channel to use, from 0")] = None,
    json: Json = False,
) -> None:
    """Find the cases of the local library that are nearest to a recording, and why they are near.

    Nothing is stored. --axis, --speed, --payload, --period and --steady say how the recording was taken; --label,
    --origin, --of-axis and --of-gearbox which cases may be found.
    """
    frame = frame_of(context)
    query = NeighbourQuery.model_validate(
        {
            "k": k,
            "representation": representation,
            "weights": dict(_weight(each) for each in weight or ()),
            "label": label or None,
            "origin": origin,
            "axis": of_axis or None,
            "gearbox": of_gearbox or None,
        }
    )
    metadata = RecordingMetadata(
        speed_rad_s=speed, payload_kg_m2=payload, motion_period_s=period, steady=steady, channel=channel
    )
    described = axis_of(frame, axis) if axis else None
    recording = decoded(file, metadata, described)
    with frame.library() as library:
        heard = hear(library, recording, file.name, media_type_of(file.name), metadata, described)
        found = neighbours_of(library, heard, query)
    if json:
        frame.print_json(found.model_dump(mode="json"))
    else:
        _show(frame, found)


def _weight(given: str) -> tuple[str, str]:
    name, equals, value = given.rpartition("=")
    if not equals:
        raise typer.BadParameter(f"--weight {given}: write NAME=VALUE, such as crest_factor=2")
    return name, value


def _show(frame: Frame, found: RetrievalAnswer) -> None:
    if found.neighbours:
        table = Table("rank", "label", "origin", "gearbox", "distance", "differs most in")
        for rank, each in enumerate(found.neighbours, 1):
            table.add_row(
                str(rank), each.label, each.origin, each.gearbox or "-", f"{each.distance:.3f}", _differences(each)
            )
        frame.results.print(table)
    for remark in found.remarks:
        frame.print(remark)


def _differences(neighbour: NeighbourAnswer) -> str:
    first = list(neighbour.contributions.items())[:SHOWN_FEATURES]
    return "; ".join(f"{feature_words(name)} {part.share:.0%}" for name, part in first)
