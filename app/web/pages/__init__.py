"""The pages, one module per noun; a new noun is one line in PAGES."""

from fastapi import APIRouter, FastAPI
from fastapi.staticfiles import StaticFiles

from app.report.formatting import STATIC
from app.web.errors import ask_which_label, sign_in_first
from app.web.labels import LabelQuestion
from app.web.page import SignInNeeded
from app.web.pages import (
    admin,
    axes,
    care,
    describe,
    diagnoses,
    first_hour,
    fleet,
    investigations,
    library,
    recordings,
    session,
    simulate,
)

PAGES: tuple[APIRouter, ...] = (
    session.router,
    fleet.router,
    diagnoses.router,
    recordings.demonstration,
    recordings.router,
    library.router,
    care.router,
    axes.router,
    axes.robots,
    describe.router,
    first_hour.router,
    simulate.router,
    investigations.router,
    admin.alarms,
    admin.router,
)


def add_pages(app: FastAPI) -> None:
    """Put the pages beside the interface of an application; they stand in no OpenAPI document."""
    for router in PAGES:
        app.include_router(router, include_in_schema=False)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_exception_handler(SignInNeeded, sign_in_first)
    app.add_exception_handler(LabelQuestion, ask_which_label)
