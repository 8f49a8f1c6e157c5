# texclass in a container: docker build -t texclass .
# The base image is pinned by its tag. To pin it by its digest, too, append the digest that
# `docker buildx imagetools inspect python:3.13.5-slim-bookworm` prints.
FROM python:3.13.5-slim-bookworm AS build

WORKDIR /src
# pip reads the first variable, and newer versions the second one for build tools.
ENV PIP_CONSTRAINT=/src/constraints.txt \
    PIP_BUILD_CONSTRAINT=/src/constraints.txt \
    PIP_DISABLE_PIP_VERSION_CHECK=1
COPY constraints.txt pyproject.toml README.md LICENSE ./
COPY texclass texclass
COPY feature_defs feature_defs
COPY pipelines pipelines
COPY datasets datasets
COPY ros2/texclass_msgs/msg ros2/texclass_msgs/msg
COPY reports/leaderboard/leaderboard.csv reports/leaderboard/leaderboard.csv
RUN python -m venv /opt/texclass && /opt/texclass/bin/pip install --no-cache-dir .

FROM python:3.13.5-slim-bookworm

# Any user may write caches and compiled code: `docker run --user` sets the owner of the results.
RUN useradd --uid 10001 --no-create-home texclass && install --directory --mode 1777 /cache /data
COPY --from=build /opt/texclass /opt/texclass
ENV PATH=/opt/texclass/bin:$PATH \
    HOME=/cache \
    TEXCLASS_CACHE=/cache/texclass \
    NUMBA_CACHE_DIR=/cache/numba \
    MPLCONFIGDIR=/cache/matplotlib \
    JOBLIB_TEMP_FOLDER=/tmp
USER 10001
WORKDIR /data
ENTRYPOINT ["texclass"]
CMD ["--help"]
