# native.mk - this machine, its own compiler and libraries.
ifeq ($(origin CC),default)
CC = gcc
endif
