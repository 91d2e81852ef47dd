"""The text of a sketch."""

from __future__ import annotations

from typing import Final

SKETCH: Final = """\
/* {title}
   {what}
   Every {step_ms} ms the pin is set, and a row of time [ms], signal, drive [V] and modelled
   reading [nm] is sent over the serial port at {baud} baud. Put a low-pass filter and an
   amplifier behind the pin, so that its full scale is {full_volts} at the actuator. */
#include "{n}.h"
{include}
const uint8_t PIN = {pin}; /* one that can modulate the width of a pulse */
const unsigned long STEP_MS = {step_ms}; /* between two samples */
const unsigned long PERIOD_MS = {period_ms}; /* of the signal */
const float LOW_END = {low}; /* {signal_words} */
const float HIGH_END = {high};
const float FULL_SCALE = {full_scale}; /* drive at the pin's largest value [V] */
const unsigned long PERIODS = {periods}; /* then the drive goes to zero; 0: for ever */
const float METRE = 1e9f; /* readings are sent in nanometres */

{n} model;
{declare}unsigned long now = 0; /* [ms] of the signal */
unsigned long due = 0; /* [ms] of the processor's clock */

/* {shape_words} */
float signal_at(unsigned long time)
{{
    const float phase = (float)(time % PERIOD_MS) / (float)PERIOD_MS;
{shape}
}}

/* The drive on the pin, as a share of its full scale. */
void put(float drive)
{{
    const float share = drive / FULL_SCALE;
    analogWrite(PIN, share <= 0.0f ? 0 : share >= 1.0f ? 255 : (int)(255.0f * share + 0.5f));
}}

void setup()
{{
    Serial.begin({baud});
    pinMode(PIN, OUTPUT);
    {n}_init(&model, {begin});
    {setup}due = millis();
}}

void loop()
{{
    if ((long)(millis() - due) < 0) return;
    due += STEP_MS;
    if (PERIODS > 0 && now > PERIOD_MS * PERIODS) {{
        put(0.0f);
        return;
    }}
    const float wanted = signal_at(now);
    const float drive = {drive};
    const float reading = now == 0
        ? {n}_output(&model) : {n}_step(&model, 1e-3f * (float)STEP_MS, drive);
    put(drive);
    Serial.print(now);
    Serial.print(',');
    Serial.print(wanted{scale}, 3);
    Serial.print(',');
    Serial.print(drive, 3);
    Serial.print(',');
    Serial.println(reading * METRE, 1);
    now += STEP_MS;
}}
"""

SHAPES: Final = {
    "triangle": (
        "Up and down again, beginning at the lower end.",
        "    return LOW_END + (HIGH_END - LOW_END) * (1.0f - fabs(2.0f * phase - 1.0f));",
    ),
    "square": (
        "Half a period at the lower end, half at the upper one.",
        "    return phase < 0.5f ? LOW_END : HIGH_END;",
    ),
}
"""What each signal is, and its value at a phase of the period."""
