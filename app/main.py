"""create_app(): routers, errors, middleware and what runs around them."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import APIRouter, Depends, FastAPI
from starlette.middleware import Middleware
from starlette.middleware.exceptions import ExceptionMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

from app.api import (
    alarms,
    axes,
    cases,
    diagnoses,
    investigations,
    jobs,
    operation,
    recordings,
    steps,
)
from app.http.errors import add_problem_handlers
from app.http.middleware import CloseUnread, HeadIsGet, Metrics, RequestRecord, SecurityHeaders
from app.http.reference import PROBLEMS, describe, only_known_query
from app.http.request_limits import RequestLimits, limits_of_all
from app.http.security import ConcurrencyLimiter
from app.report.formatting import STATIC
from app.service import Service
from app.settings import Settings, settings_of
from app.web.forms import LabelQuestion
from app.web.page import PageErrors, SignInNeeded, ask_which_label, sign_in_first
from app.web.pages import admin as admin_pages
from app.web.pages import axes as axes_pages
from app.web.pages import care as care_pages
from app.web.pages import describe as describe_pages
from app.web.pages import diagnoses as diagnoses_pages
from app.web.pages import first_hour as first_hour_pages
from app.web.pages import investigations as investigations_pages
from app.web.pages import library as library_pages
from app.web.pages import simulate as simulate_pages
from signals.reading.decode import warm_up

ROUTERS: tuple[APIRouter, ...] = (
    diagnoses.router,
    cases.router,
    recordings.router,
    steps.router,
    axes.router,
    axes.robots,
    jobs.simulations,
    jobs.router,
    alarms.router,
    investigations.router,
    operation.inside,
)
"""Everything under /api/v1; a new noun is one line here."""

PAGES: tuple[APIRouter, ...] = (
    axes_pages.fleet_router,
    diagnoses_pages.router,
    library_pages.demonstration,
    library_pages.recordings,
    library_pages.router,
    care_pages.router,
    axes_pages.router,
    axes_pages.robots,
    describe_pages.router,
    first_hour_pages.router,
    simulate_pages.router,
    investigations_pages.router,
    admin_pages.alarms,
    admin_pages.router,
)
"""What is shown to people, in no OpenAPI document; a new noun is one line here."""

DESCRIPTION = """Diagnosis of robot gearboxes from their sound by comparison with known cases.

Send a recording to `POST /api/v1/diagnoses`; the answer names the fault, the nearest known cases and how much they
are alike. It is an aid for people who maintain gearboxes, not a safety function."""


def leave(_: Request, error: Exception) -> Response:
    """Answer nobody: the client has left."""
    raise error


def attach(app: FastAPI, service: Service) -> None:
    """Give the application what its requests are answered from, and the limits of what they may do at once."""
    settings = service.settings
    longest_wait_s, at_work = settings.longest_wait_s, settings.work_at_once
    app.state.service = service
    app.state.uploads = ConcurrencyLimiter(settings.uploads_at_once, settings.uploads_per_key, longest_wait_s)
    app.state.at_work = ConcurrencyLimiter(at_work, at_work, longest_wait_s)
    app.state.looking = ConcurrencyLimiter(settings.looks_at_once, settings.looks_per_key, longest_wait_s)


def create_app(settings: Settings | None = None, service: Service | None = None) -> FastAPI:
    """Return the application. With a service that is already open, the caller closes it."""
    settings = settings or (service.settings if service else settings_of())
    metrics = service.metrics if service else Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        running = service or Service.open(settings, metrics)
        attach(app, running)
        warm_up()
        limits_of_all(app)
        running.upkeep.start()
        for work in running.by_itself:
            work.start()
        yield
        if service is None:
            running.close()

    app = FastAPI(
        title="Gearcase",
        version=version("gearcase"),
        description=DESCRIPTION,
        root_path=settings.root_path,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        middleware=[
            Middleware(CloseUnread),
            Middleware(RequestRecord, metrics=metrics),
            Middleware(SecurityHeaders),
            Middleware(HeadIsGet),
            Middleware(PageErrors),
        ],
    )
    add_problem_handlers(app)
    for router in ROUTERS:
        app.include_router(router, prefix="/api/v1", responses=PROBLEMS, dependencies=[Depends(only_known_query)])
    app.include_router(operation.router, responses=PROBLEMS)
    for router in PAGES:
        app.include_router(router, include_in_schema=False)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_exception_handler(SignInNeeded, sign_in_first)
    app.add_exception_handler(LabelQuestion, ask_which_label)
    app.user_middleware += [  # innermost: what it answers, faults too, passes what every answer passes
        Middleware(ExceptionMiddleware, handlers={**app.exception_handlers, ClientDisconnect: leave}),
        Middleware(RequestLimits, settings=settings),
    ]
    app.openapi = lambda: describe(app)  # type: ignore[method-assign]
    return app
