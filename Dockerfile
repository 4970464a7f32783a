# The package on CPUs, for engines that start containers: `docker build -t srl-jax .`, then
#     docker run --rm -v "$PWD/sweeps:/data/sweeps" srl-jax sweep --preset smoke --out sweeps/first
# Results go to /data, which should be a volume; every verb of `srl-jax` is a verb of the image.
FROM python:3.11-slim

RUN apt-get update \
    && apt-get install -y --no-install-recommends make \
    && rm -rf /var/lib/apt/lists/*

# The installation is the one of the README, at the versions of constraints.txt.
WORKDIR /opt/srl_jax
COPY . .
RUN make install && rm -rf /root/.cache/pip

ENV PATH=/opt/srl_jax/.venv/bin:$PATH
# A task must get its TERM itself, to save: so no shell around it.
WORKDIR /data
ENTRYPOINT ["srl-jax"]
CMD ["--help"]
