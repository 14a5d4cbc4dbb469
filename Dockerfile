# The program and its desk: docker build --tag gruber . && docker run --volume "$PWD:/blocks" gruber
FROM python:3.11-slim AS wheel
WORKDIR /source
COPY pyproject.toml requirements.lock README.md LICENSE ./
COPY app app
COPY core core
COPY gruber gruber
COPY sessions sessions
COPY ui ui
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.11-slim
COPY --from=wheel /wheel /wheel
COPY requirements.lock /wheel/
# The same versions as the tests ran with; Dask for batches on many machines.
RUN pip install --no-cache-dir --constraint /wheel/requirements.lock \
        "gruber[cluster] @ file://$(echo /wheel/gruber-*.whl)" \
    && useradd --create-home --uid 1000 gruber \
    && install --directory --owner gruber /blocks
USER 1000:1000
WORKDIR /blocks
VOLUME /blocks
EXPOSE 8765
# As Ctrl-C: what is under way is left so that the next call resumes it.
STOPSIGNAL SIGINT
# Without the token of the address it printed the desk answers 401, and so lives.
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s CMD ["python", "-c", \
    "from http.client import HTTPConnection as C; c = C('127.0.0.1', 8765, timeout=4); c.request('GET', '/'); raise SystemExit(c.getresponse().status != 401)"]
ENTRYPOINT ["gruber"]
CMD ["review", "/blocks", "--host", "0.0.0.0", "--no-browser"]
