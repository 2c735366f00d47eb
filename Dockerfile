# fx_contact in Debian 13, with its dolfinx 0.9:   docker build -t fx_contact .
# Debian unstable, with a newer dolfinx:           docker build -t fx_contact:sid --build-arg SUITE=sid .
# Run in the present folder:   docker run --rm -v "$PWD:/work" fx_contact mpirun -n 2 python3 /opt/fx_contact/demos/hertz.py
# All tests:                   docker run --rm fx_contact /opt/fx_contact/tests/run --all
ARG SUITE=trixie
FROM debian:${SUITE}-slim

COPY packages.txt /opt/fx_contact/
RUN apt-get update \
    && apt-get install -y --no-install-recommends $(sed 's/#.*//' /opt/fx_contact/packages.txt) \
    && rm -rf /var/lib/apt/lists/*

COPY . /opt/fx_contact/
# More ranks than cores are allowed, as ./with-dolfinx allows them; HOME holds the kernels that FFCx compiles.
ENV PYTHONPATH=/opt/fx_contact/src OMP_NUM_THREADS=1 LC_ALL=C.UTF-8 \
    OMPI_MCA_mpi_yield_when_idle=1 PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
RUN useradd --create-home fx && mkdir /work && chown fx /work
USER fx
WORKDIR /work
