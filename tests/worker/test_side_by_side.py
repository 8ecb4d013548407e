"""Lanes refine what one refines alone, byte for byte, whatever their number and what they refined before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.errors import ProtocolError
from common.settings import preset
from tests.support.bodies import puppet, random_body
from worker.kernel.job import refine
from worker.lanes import Lanes
from worker.side_by_side import SideBySide
