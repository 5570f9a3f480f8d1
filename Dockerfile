# GES as a program:   docker build -t ges . && docker run --rm -v "$PWD:/data" ges diagnose flights --out diagnosis
FROM python:3.13-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev make
COPY . /ges
RUN pip wheel --no-deps --wheel-dir /wheel /ges

FROM python:3.13-slim-bookworm
COPY --from=build /wheel /wheel
COPY requirements.lock /wheel/
# Hashes would have to cover the wheel itself; versions are those that the tests ran with.
RUN sed -n 's/^\([a-z].*\) \\$/\1/p' /wheel/requirements.lock > /wheel/constraints.txt \
    && pip install --no-cache-dir --constraint /wheel/constraints.txt /wheel/*.whl && rm -r /wheel
RUN useradd --create-home ges
USER ges
WORKDIR /data
ENTRYPOINT ["ges"]
CMD ["--help"]
