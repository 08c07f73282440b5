# dexgrasp in a container, compiled when it is built:
#
#     docker build -t dexgrasp .
#     docker run --rm --network none --read-only --tmpfs /tmp dexgrasp                      plans and lifts a box: demo
#     docker run --rm -v "$PWD/out:/out" -u "$(id -u)" dexgrasp plan mustard_bottle --out /out/mustard
#
# Any user may run it, with no home, no network and a read-only root file system. What is compiled is for processors
# like the one that built it; on others it is compiled anew, in each container.
FROM python:3.11-slim

RUN apt-get update && apt-get install -y --no-install-recommends libosmesa6 && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/dexgrasp
COPY pyproject.toml constraints.txt README.md LICENSE CHANGELOG.md CITATION.cff ./
COPY dexgrasp_env dexgrasp_env
COPY dexgrasp dexgrasp
COPY agents agents
COPY assets assets
RUN pip install --no-cache-dir --prefer-binary -c constraints.txt '.[planner]'

ENV DEXGRASP_CACHE=/opt/dexgrasp/cache
ENV MPLCONFIGDIR=/tmp
RUN dexgrasp warmup && dexgrasp demo --no-pictures --out /opt/dexgrasp/first && rm -r /opt/dexgrasp/first

RUN useradd --uid 10001 --no-create-home dexgrasp && chown -R dexgrasp /opt/dexgrasp/cache
USER dexgrasp
WORKDIR /tmp
ENTRYPOINT ["dexgrasp"]
CMD ["demo", "--out", "/tmp/demo"]
